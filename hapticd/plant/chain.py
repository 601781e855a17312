"""Windows of a record predicted one after the other, so that a device's memory is handed on between them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from numba import types

from hapticd.jit import njit
from hapticd.plant.layout import BRISTLE, CONTACT, LOAD_OMEGA, LOAD_THETA, OMEGA, THETA
from hapticd.plant.numeric import measured, mechanical

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_i8 = types.int64
_a = types.Array(_f8, 1, "C")
_m = types.Array(_f8, 2, "C")


@njit(types.void(_a, _a), counted=False)
def inherit(state: NDArray[Any], before: NDArray[Any]) -> None:
    """Take over the memory that a device has at the end of the window before.

    The bristle keeps its deflection; the load keeps its place and velocity relative to the shaft.

    Args:
        state: new state, with shaft position and velocity set; changed in place.
        before: state at the end of the window before.
    """
    state[BRISTLE] = before[BRISTLE]
    state[LOAD_THETA] = state[THETA] + (before[LOAD_THETA] - before[THETA])
    state[LOAD_OMEGA] = state[OMEGA] + (before[LOAD_OMEGA] - before[OMEGA])
    state[CONTACT] = before[CONTACT]


@njit(types.void(_a, _a, _m, types.Array(_i8, 1, "C"), _i8, _m, _m, _m))
def simulate_chain(
    p: NDArray[Any],
    time_s: NDArray[Any],
    i_sub: NDArray[Any],
    start: NDArray[Any],
    length: int,
    state0: NDArray[Any],
    out_position: NDArray[Any],
    out_end: NDArray[Any],
) -> None:
    """As `hapticd.plant.numeric.simulate_windows_serial`, for a device that remembers more than its motion.

    Where a window begins at the row at which the one before ended, it takes over what that one remembers (`inherit`); shaft
    position and velocity are those of `state0`. Other windows start from `state0` as it is.
    """
    for w in range(len(start)):
        state = out_end[w]
        state[:] = state0[w]
        if w > 0 and start[w] == start[w - 1] + length:
            inherit(state, out_end[w - 1])
        for j in range(length):
            k = start[w] + j
            mechanical(p, state, time_s[k], time_s[k + 1] - time_s[k], i_sub[k])
            out_position[w, j] = measured(p, state[THETA])
