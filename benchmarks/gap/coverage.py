"""Whether the 95 % intervals of an answer hold the true parameters."""

from __future__ import annotations

import math
from typing import Any

from benchmarks.gap.score import Answer, Truth, names_it, verdict_of

_PHASES = {("gravity", "theta_0"), ("encoder_eccentricity", "phi"), ("encoder_eccentricity", "phi_2")}
"""Angles that come round again."""


def inside(answer: Answer, truth: Truth) -> list[tuple[str, bool]]:
    """Every parameter of the rightly named effects that has an interval, and whether it holds the true value.

    A bias named for an asymmetric friction, or the reverse, is compared through τ₀ = −a c. Orders of a ripple are matched
    by number, amplitude by amplitude.
    """
    if verdict_of(answer) in ("late", "failed", "unexplained"):
        return []
    return [pair for effect in truth["effects"] for pair in _of_effect(answer, effect, truth["coulomb"])]


def _of_effect(answer: Answer, effect: dict[str, Any], coulomb: float) -> list[tuple[str, bool]]:
    hidden = effect["name"]
    step = next((s for s in answer.get("steps", []) if names_it(answer, s["effect"], hidden)), None)
    if step is None:
        return []
    found, wanted = step["parameters"], {key: value for key, value in effect.items() if key != "name"}
    if step["effect"] != hidden:
        wanted = {"tau_0": -effect["a"] * coulomb} if "a" in effect else {"a": -effect["tau_0"] / coulomb}
    elif hidden == "torque_ripple":
        found, wanted = _ripple(found, wanted)
    return [
        (f"{hidden}: {name}", _holds(interval, value, around=(hidden, name) in _PHASES))
        for name, value in wanted.items()
        if name in found and (interval := _interval(found[name])) is not None
    ]


def _interval(estimate: dict[str, Any]) -> tuple[float, float] | None:
    bounds = estimate.get("ci95")
    if bounds is None or None in bounds or not all(math.isfinite(bound) for bound in bounds):
        return None
    return float(bounds[0]), float(bounds[1])


def _holds(interval: tuple[float, float], true: float, *, around: bool) -> bool:
    low, high = interval
    if around:
        middle = 0.5 * (low + high)
        true = middle + math.remainder(true - middle, 2.0 * math.pi)
    return low <= true <= high


def _ripple(parameters: dict[str, Any], wanted: dict[str, Any]) -> tuple[dict[str, Any], dict[str, float]]:
    """Amplitudes by order, from parameters that are lists or numbered (``amplitudes[0]``)."""
    orders, intervals = listed(parameters, "orders", "value"), listed(parameters, "amplitudes", "ci95")
    found, true = {}, {}
    for order, amplitude in zip(wanted["orders"], wanted["amplitudes"], strict=True):
        index = next((i for i, value in enumerate(orders) if abs(value - order) < 0.25), None)
        if index is not None and index < len(intervals):
            name = f"amplitude of order {order:g}"
            found[name], true[name] = {"ci95": intervals[index]}, float(amplitude)
    return found, true


def listed(parameters: dict[str, Any], name: str, key: str) -> list[Any]:
    """One field of a parameter that is a list, or of those numbered ``name[0]``, ``name[1]`` and so on."""
    if name in parameters:
        value = parameters[name][key]
        return list(value) if isinstance(value, list) else [value]
    return [entry[key] for full, entry in parameters.items() if full.startswith(f"{name}[")]
