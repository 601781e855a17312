"""Which names are right for a machine, which are near, and what the base is."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from benchmarks.gap.foreign.machines import Drawn

Names = tuple[set[str], set[str]]
"""Right ones, near ones."""

_BIAS = {"constant_bias", "asymmetric_coulomb"}
_FRICTION: dict[str, Names] = {
    "straight": (set(), set()),
    "degressive": ({"quadratic_drag", "stribeck"}, set()),
    "stribeck": ({"stribeck"}, {"quadratic_drag", "presliding"}),
    "rising": ({"stribeck", "quadratic_drag"}, {"presliding"}),
    "presliding": ({"presliding"}, {"stribeck", "backlash"}),
}
_LATE: Names = ({"transport_delay", "amplifier_lag"}, set())
_FAULT: dict[str, Names] = {"device_delay": _LATE, "stale": _LATE, "unsynchronised": (_LATE[0], {"dropped_samples"})}
SIGNS = {
    "degressive": {"quadratic_drag": -1, "stribeck": -1},
    "rising": {"quadratic_drag": -1, "stribeck": -1},
    "stribeck": {"stribeck": 1},
}
"""Signs that d and s must have."""


def ingredients(drawn: Drawn, friction: str, fault: str) -> Iterator[Names]:
    """The names for each thing that the base lacks."""
    machine = drawn.machine
    yield _FRICTION[friction]
    if machine.stribeck < 0.0 and friction == "presliding":
        yield _FRICTION["rising"]
    yield _FAULT.get(fault, (set(), set()))
    if machine.asymmetry:
        yield {"asymmetric_viscous"}, _BIAS
    if machine.bias:
        yield _BIAS, {"asymmetric_viscous"}
    if machine.gravity:
        yield {"gravity"}, {*_BIAS, "return_spring", "torque_ripple"}
    if any(machine.amplitudes):
        yield {"torque_ripple"} | ({"gravity"} if 1.0 in machine.orders else set()), set()


def names(drawn: Drawn, friction: str, fault: str) -> dict[str, Any]:
    """``right``, ``near``, ``signs`` of their parameters, ``orders`` of ripples, ``friction_is_free``."""
    found = list(ingredients(drawn, friction, fault))
    right = set().union(*(each[0] for each in found))
    near = set().union(*(each[1] for each in found)) - right
    machine = drawn.machine
    if machine.breakaway >= 0.3 * machine.resolution:
        right, near = right | {"presliding"}, near - {"presliding"}
    return {
        "right": sorted(right),
        "near": sorted(near),
        "signs": SIGNS.get("rising" if machine.stribeck < 0.0 else friction, {}),
        "orders": [*machine.orders] if any(machine.amplitudes) else [1.0] if machine.gravity else [],
        "friction_is_free": friction != "straight" or machine.stribeck != 0.0 or machine.asymmetry != 0.0,
    }
