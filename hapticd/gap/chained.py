"""Initial states of windows of a device with a memory, fitted one window after the other.

What a window inherits (a bristle, a load behind play or a spring) depends on all windows before it. Fitting all at once
would chase a memory that changes with every step; so a window is fitted to the end before the next one takes over.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numba import types

from hapticd.jit import njit
from hapticd.plant.chain import inherit
from hapticd.plant.layout import LOAD_OMEGA, LOAD_THETA, OMEGA, STATE, THETA
from hapticd.plant.numeric import measured, mechanical

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8, _i8 = types.float64, types.int64
_a, _m = types.Array(_f8, 1, "C"), types.Array(_f8, 2, "C")
_STATE = STATE
_RIDGE = 1e-6
_ALWAYS = 2
_GAIN = 1e-3
"""Share of a window's sum of squares below which a step is the last one."""


@njit(_f8(_a, _a, _m, _i8, _i8, _a, _a, _a), counted=False)
def _error(
    p: NDArray[Any],
    time_s: NDArray[Any],
    i_sub: NDArray[Any],
    start: int,
    parts: int,
    state: NDArray[Any],
    observed: NDArray[Any],
    error: NDArray[Any],
) -> float:
    """Sum of squared prediction errors of one window, which begins at `state` and leaves its end there."""
    square = 0.0
    for j in range(len(observed)):
        for part in range(parts):
            k = start + j * parts + part
            mechanical(p, state, time_s[k], time_s[k + 1] - time_s[k], i_sub[k])
        error[j] = observed[j] - measured(p, state[THETA])
        square += error[j] * error[j]
    return square


@njit(_f8(_a, _a, _m, _i8, _i8, _a, _a, _f8, _f8, _i8, _m))
def _refined(
    p: NDArray[Any],
    time_s: NDArray[Any],
    i_sub: NDArray[Any],
    start: int,
    parts: int,
    begin: NDArray[Any],
    observed: NDArray[Any],
    position_step: float,
    velocity_step: float,
    iterations: int,
    space: NDArray[Any],
) -> float:
    """Move the initial state `begin` of one window to where it predicts best; returns the sum of squares there.

    `space` (4, L) holds intermediate results.
    """
    length = len(observed)
    error, moved = space[0], space[1]
    slope = space[2:]
    state, trial = np.empty(_STATE), np.empty(_STATE)
    state[:] = begin
    least = _error(p, time_s, i_sub, start, parts, state, observed, error)
    for _ in range(iterations):
        for part in range(2):
            step = position_step if part == 0 else velocity_step
            state[:] = begin
            state[THETA if part == 0 else OMEGA] += step
            state[LOAD_THETA if part == 0 else LOAD_OMEGA] += step
            _error(p, time_s, i_sub, start, parts, state, observed, moved)
            for j in range(length):
                slope[part, j] = (error[j] - moved[j]) / step
        a = b = c = f = g = 0.0
        for j in range(length):
            a += slope[0, j] ** 2
            b += slope[0, j] * slope[1, j]
            c += slope[1, j] ** 2
            f += slope[0, j] * error[j]
            g += slope[1, j] * error[j]
        a += _RIDGE * length
        c += _RIDGE * length * (position_step / velocity_step) ** 2
        determinant = a * c - b * b
        better = False
        for share in (1.0, 0.3, 0.1, 0.0):
            trial[:] = begin
            go, speed = share * (c * f - b * g) / determinant, share * (a * g - b * f) / determinant
            if share == 0.0:
                # What the velocity of a shaft that is about to slip does is known to no first order.
                go = f / a
            trial[THETA] += go
            trial[LOAD_THETA] += go
            trial[OMEGA] += speed
            trial[LOAD_OMEGA] += speed
            state[:] = trial
            square = _error(p, time_s, i_sub, start, parts, state, observed, moved)
            if square < least:
                better = square < (1.0 - _GAIN) * least
                least = square
                begin[:] = trial
                error[:] = moved
                break
        if not better:
            break
    return least


@njit(types.void(_a, _a, _m, types.Array(_i8, 1, "C"), _i8, types.Array(_f8, 3, "C"), _m, _f8, _f8, _f8, _i8, _m))
def fit_chain(
    p: NDArray[Any],
    time_s: NDArray[Any],
    i_sub: NDArray[Any],
    start: NDArray[Any],
    parts: int,
    tries: NDArray[Any],
    observed: NDArray[Any],
    position_step: float,
    velocity_step: float,
    good: float,
    iterations: int,
    out: NDArray[Any],
) -> None:
    """Find the initial state of each window that predicts it best, given what the windows before left.

    Args:
        p: device vector.
        time_s: times (n,) of the rows [s].
        i_sub: motor current (n, substeps) [A].
        start: first row (w,) of each window.
        parts: rows of one recorded tick.
        tries: states (t, w, STATE) to start from; all but the first two only where these are not good.
        observed: positions (w, L).
        position_step, velocity_step: difference steps, of the size of a sample's noise.
        good: mean squared error with which a window needs no other start.
        iterations: Gauss–Newton steps from the best of the tries; from all of them, as long as the window is not good.
        out: (w, STATE) the initial states.
    """
    length = observed.shape[1]
    end = np.zeros(_STATE)
    begin, state = np.empty(_STATE), np.empty(_STATE)
    space = np.empty((4, length))
    for w in range(len(start)):
        follows = w > 0 and start[w] == start[w - 1] + length * parts
        first, least = 0, np.inf
        for t in range(tries.shape[0]):
            if t >= _ALWAYS and least < good * length:
                break
            state[:] = tries[t, w]
            if follows:
                inherit(state, end)
            square = _error(p, time_s, i_sub, start[w], parts, state, observed[w], space[0])
            if square < least or t == 0:
                first, least = t, square
        best = np.inf
        for turn in range(tries.shape[0]):
            t = (first + turn) % tries.shape[0]
            state[:] = tries[t, w]
            if follows:
                inherit(state, end)
            square = _refined(
                p, time_s, i_sub, start[w], parts, state, observed[w], position_step, velocity_step, iterations, space
            )
            if square < best or turn == 0:
                best = square
                begin[:] = state
            if best < good * length:
                break
        out[w] = begin
        end[:] = begin
        _error(p, time_s, i_sub, start[w], parts, end, observed[w], space[0])
