"""Which commands of a window were lost: a Kalman filter for each of the likeliest sets of losses (Blom and Bar-Shalom 1988).

In a lost tick the current that was there stays until a command arrives. A prediction with the fates assumed so far is off
by δ(t); a window's residual is what δ is measured by. δ obeys the motion of a free shaft, driven by the difference of the
currents, and at each tick every hypothesis splits in two: the command arrived, or it did not. All hypotheses of a window
have the same covariance; those that have become alike are merged into their mean, and the likeliest few go on. With cells
too small, or too few that go on, losses that show little are left out, and the probability comes out low.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import types

from hapticd.jit import njit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Mask = NDArray[np.bool_]

_f8, _i8 = types.float64, types.int64
_v, _m = types.Array(_f8, 1, "C"), types.Array(_f8, 2, "C")
_KEPT = 200
_ALIKE = 1.5
"""Standard deviations of the state within which two hypotheses are one."""
_FREE = 1e3
"""Standard deviation of the initial state, in those of a sample: as good as unknown."""
_UNLIKELY = 30.0
"""Log of a share of the likeliest that makes no difference."""
_POSITION, _VELOCITY, _CURRENT, _WEIGHT, _LIKELIHOOD, _FIRST, _SECOND, _PARENT, _LOST = range(9)
"""Columns of a hypothesis: state, command in force, log of prior times likelihood of all sets in it, log likelihood of the
likeliest, moments of the number of losses, and in the likeliest, the hypothesis before this tick and this tick's fate."""


class Shaft(NamedTuple):
    """How δ moves, in standard deviations of a position sample; the velocity is that per tick."""

    decay: float
    """Factor by which friction slows δ in a tick."""
    push: Floats
    """Velocity (w, L) that a unit of current gives in each tick; 0 where the shaft sticks."""


class Fates(NamedTuple):
    """What the residuals of windows say of each command."""

    lost: Mask
    """(w, L) in the likeliest set of losses."""
    number: Floats
    """Expected losses (w,)."""
    spread: Floats
    """Variance (w,) of that number, given the data."""
    price: Floats
    """(w,) what it costs to have chosen the likeliest set: −2 log of the sum over all sets of prior times likelihood, less
    the sum of squares that the likeliest leaves."""


def effective(command: Floats, lost: Mask) -> Floats:
    """Commands (n,) that are in force: where one is lost, the last one that arrived."""
    arrived = np.where(lost, 0, np.arange(len(command)))
    return np.asarray(command[np.maximum.accumulate(arrived)])


def find(residual: Floats, shaft: Shaft, command: Floats, assumed: Floats, before: Floats, probability: float) -> Fates:
    """The fates of all ticks of some windows.

    Args:
        residual: (w, L) in standard deviations, of a prediction with the currents assumed.
        shaft: how a wrong current shows.
        command: (w, L).
        assumed: current (w, L) that the prediction had.
        before: command (w,) in force before the window.
        probability: of a loss.
    """
    windows, length = residual.shape
    lost, told = np.zeros((windows, length), dtype=np.bool_), np.empty((windows, 3))
    _filter(
        np.ascontiguousarray(residual),
        np.ascontiguousarray(shaft.push),
        np.ascontiguousarray(command),
        np.ascontiguousarray(assumed),
        np.ascontiguousarray(before),
        shaft.decay,
        probability,
        lost,
        told,
    )
    return Fates(lost, told[:, 0].copy(), told[:, 1].copy(), told[:, 2].copy())


@njit(_i8(_m, _i8, _f8, _f8, _m))
def _merged(split: NDArray[Any], count: int, position: float, velocity: float, kept: NDArray[Any]) -> int:
    """The likeliest hypotheses, with those that are alike taken for one.

    Args:
        split: (m, 9), the first `count` of them. position, velocity: sizes of a cell in which states are alike.
        kept: (k, 9) those that go on; their number is returned.
    """
    # One number that differs where any of the three does.
    cell = np.rint(split[:count, _POSITION] / position) + np.pi * np.rint(split[:count, _VELOCITY] / velocity)
    key = cell + np.e * 1e6 * split[:count, _CURRENT]
    order = np.argsort(key)
    groups, begin = 0, 0
    while begin < count:
        end = head = begin
        while end < count and key[order[end]] == key[order[begin]]:
            if split[order[end], _WEIGHT] > split[order[head], _WEIGHT]:
                head = end
            end += 1
        total = first = second = place = speed = 0.0
        for k in range(begin, end):
            share = np.exp(split[order[k], _WEIGHT] - split[order[head], _WEIGHT])
            total += share
            place += share * split[order[k], _POSITION]
            speed += share * split[order[k], _VELOCITY]
            first += share * split[order[k], _FIRST]
            second += share * split[order[k], _SECOND]
        row = split[order[head]]
        row[_WEIGHT] += np.log(total)
        row[_FIRST], row[_SECOND] = first / total, second / total
        row[_POSITION], row[_VELOCITY] = place / total, speed / total
        order[groups] = order[head]
        groups += 1
        begin = end
    heads = order[:groups]
    likeliest = heads[np.argsort(-split[heads, _WEIGHT])]
    number = 0
    for k in likeliest[: len(kept)]:
        if split[k, _WEIGHT] < split[likeliest[0], _WEIGHT] - _UNLIKELY:
            break
        kept[number] = split[k]
        number += 1
    return number


@njit(types.void(_m, _m, _m, _m, _v, _f8, _f8, types.Array(types.boolean, 2, "C"), _m))
def _filter(
    residual: NDArray[Any],
    push: NDArray[Any],
    command: NDArray[Any],
    assumed: NDArray[Any],
    before: NDArray[Any],
    decay: float,
    probability: float,
    lost: NDArray[Any],
    told: NDArray[Any],
) -> None:
    """As `find`; fills `lost` (w, L) and `told` (w, 3): number, spread, price."""
    windows, length = residual.shape
    way = (1.0 - decay) / -np.log(decay) if decay < 1.0 - 1e-9 else 1.0
    arrives, misses = np.log1p(-probability), np.log(probability)
    beam, split = np.zeros((_KEPT, 9)), np.empty((2 * _KEPT, 9))
    parent = np.empty((length, _KEPT), dtype=np.int64)
    missed = np.empty((length, _KEPT), dtype=np.bool_)
    for w in range(windows):
        count = 1
        beam[0] = 0.0
        beam[0, _CURRENT] = before[w]
        a, b, c = _FREE**2, 0.0, _FREE**2
        for tick in range(length):
            a, b, c = a + 2.0 * way * b + way * way * c, decay * (b + way * c), decay * decay * c
            total = a + 1.0
            to_position, to_velocity = a / total, b / total
            a, b, c = a - to_position * a, b - to_position * b, c - to_velocity * b
            for k in range(2 * count):
                one = split[k]
                one[:] = beam[k % count]
                one[_PARENT], one[_LOST] = k % count, k // count
                if k < count:
                    one[_CURRENT] = command[w, tick]
                    one[_WEIGHT] += arrives
                else:
                    one[_WEIGHT] += misses
                    one[_SECOND] += 2.0 * one[_FIRST] + 1.0
                    one[_FIRST] += 1.0
                gain = (one[_CURRENT] - assumed[w, tick]) * push[w, tick]
                position = one[_POSITION] + way * one[_VELOCITY] + 0.5 * gain
                surprise = residual[w, tick] - position
                one[_POSITION] = position + to_position * surprise
                one[_VELOCITY] = decay * one[_VELOCITY] + gain + to_velocity * surprise
                fit = -0.5 * surprise * surprise / total
                one[_WEIGHT] += fit
                one[_LIKELIHOOD] += fit
            count = _merged(split, 2 * count, _ALIKE * np.sqrt(a), _ALIKE * np.sqrt(c), beam)
            for k in range(count):
                parent[tick, k], missed[tick, k] = int(beam[k, _PARENT]), beam[k, _LOST] > 0.0
        share = np.exp(beam[:count, _WEIGHT] - beam[0, _WEIGHT])
        whole = share.sum()
        number = (share * beam[:count, _FIRST]).sum() / whole
        told[w, 0] = number
        told[w, 1] = max((share * beam[:count, _SECOND]).sum() / whole - number * number, 0.0)
        told[w, 2] = -2.0 * (beam[0, _WEIGHT] + np.log(whole) - beam[0, _LIKELIHOOD])
        best = 0
        for tick in range(length - 1, -1, -1):
            lost[w, tick] = missed[tick, best]
            best = parent[tick, best]
