"""Effect terms of other packages: called through the addresses in the device vector (`layout`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numba import types

from hapticd.jit import call_effect_term, njit
from hapticd.plant.layout import (
    HOOK_FORCE,
    HOOK_FRICTION,
    HOOK_NEUTRAL,
    HOOK_PARAMETERS,
    HOOK_SIZE,
    HOOKS,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_p = types.Array(_f8, 1, "C")


@njit(types.boolean(_p), counted=False, inline=True)
def are_installed(p: NDArray[Any]) -> bool:
    """Whether there are such effects; if not, the other functions need not be called."""
    return p[HOOKS + HOOK_SIZE] != 0.0


@njit(types.boolean(_p, types.int64), counted=False, inline=True)
def _is_on(p: NDArray[Any], block: int) -> bool:
    return p[block + HOOK_PARAMETERS] != p[block + HOOK_NEUTRAL]


@njit(types.boolean(_p), counted=False)
def are_on(p: NDArray[Any]) -> bool:
    """Whether the device has one of them."""
    block = HOOKS
    while p[block + HOOK_SIZE] != 0.0:
        if _is_on(p, block):
            return True
        block += int(p[block + HOOK_SIZE])
    return False


@njit(_f8(_p, _f8, _f8, _f8, _f8), counted=False)
def hooked_torque(p: NDArray[Any], position: float, velocity: float, time: float, current: float) -> float:
    """Return the sum of their torques or forces on the shaft."""
    total = 0.0
    block = HOOKS
    while p[block + HOOK_SIZE] != 0.0:
        address = int(p[block + HOOK_FORCE])
        if address != 0 and _is_on(p, block):
            total += call_effect_term(address, position, velocity, time, current, p, block + HOOK_PARAMETERS)
        block += int(p[block + HOOK_SIZE])
    return total


@njit(_f8(_p, _f8, _f8, _f8), counted=False)
def hooked_friction(p: NDArray[Any], speed: float, torque: float, time: float) -> float:
    """Return the sum of their additions to the Coulomb friction."""
    total = 0.0
    block = HOOKS
    while p[block + HOOK_SIZE] != 0.0:
        address = int(p[block + HOOK_FRICTION])
        if address != 0 and _is_on(p, block):
            total += call_effect_term(address, speed, torque, time, 0.0, p, block + HOOK_PARAMETERS)
        block += int(p[block + HOOK_SIZE])
    return total
