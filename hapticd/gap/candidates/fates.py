"""Which commands of a window were lost: a Kalman filter for each of the likeliest sets of losses (Blom and Bar-Shalom 1988).

In a lost tick the current that was there stays until a command arrives. A prediction with the fates assumed so far is off
by δ(t); a window's residual is what δ is measured by. δ obeys the motion of a free shaft, driven by the difference of the
currents, and at each tick every hypothesis splits in two: the command arrived, or it did not. All hypotheses of a window
have the same covariance; those that have become alike are merged, and the likeliest few go on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Mask = NDArray[np.bool_]

_KEPT = 96
_ALIKE = 0.5
"""Standard deviations of the state within which two hypotheses are one."""
_FREE = 1e3
"""Standard deviation of the initial state, in those of a sample: as good as unknown."""
_NONE = -1e9
"""Weight of no hypothesis."""


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


class _Beam(NamedTuple):
    """Hypotheses (w, m) of windows."""

    position: Floats
    velocity: Floats
    current: Floats
    """Command in force."""
    weight: Floats
    """Log of prior times likelihood; `_NONE` where there is no hypothesis."""
    likelihood: Floats
    """Log likelihood of the likeliest set in it."""
    first: Floats
    second: Floats
    """Moments of the number of losses."""
    lost: Mask
    """(w, m, L) likeliest set."""

    def chosen(self, index: NDArray[np.int64]) -> _Beam:
        """Hypotheses at `index` (w, m)."""
        numbers = [np.take_along_axis(x, index, 1) for x in self[:-1]]
        return _Beam._make([*numbers, np.take_along_axis(self.lost, index[..., None], 1)])


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
    zero = np.zeros((windows, 1))
    beam = _Beam(zero, zero, before[:, None], zero, zero, zero, zero, np.zeros((windows, 1, length), dtype=np.bool_))
    slows = shaft.decay
    way = (1.0 - slows) / -np.log(slows) if slows < 1.0 - 1e-9 else 1.0
    move = np.array([[1.0, way], [0.0, slows]])
    covariance = np.broadcast_to(np.eye(2) * _FREE**2, (windows, 2, 2))
    for tick in range(length):
        beam = _split(beam, command[:, tick, None], tick, probability)
        gain = (beam.current - assumed[:, tick, None]) * shaft.push[:, tick, None]
        position, velocity = beam.position + way * beam.velocity + 0.5 * gain, slows * beam.velocity + gain
        covariance = move @ covariance @ move.T
        total = covariance[:, 0, 0] + 1.0
        share = covariance[:, :, 0] / total[:, None]
        covariance = covariance - share[:, :, None] * covariance[:, None, 0, :]
        surprise = residual[:, tick, None] - position
        fit = -0.5 * surprise**2 / total[:, None]
        beam = beam._replace(
            position=position + share[:, :1] * surprise,
            velocity=velocity + share[:, 1:] * surprise,
            weight=beam.weight + fit,
            likelihood=beam.likelihood + fit,
        )
        beam = _merged(beam, np.sqrt(covariance[:, (0, 1), (0, 1)]))
    best = np.argmax(beam.weight, axis=1)
    each = np.arange(windows)
    relative = np.exp(beam.weight - beam.weight.max(axis=1, keepdims=True))
    share = relative / relative.sum(axis=1, keepdims=True)
    count = (share * beam.first).sum(axis=1)
    whole = beam.weight.max(axis=1) + np.log(relative.sum(axis=1))
    return Fates(
        beam.lost[each, best],
        count,
        np.maximum((share * beam.second).sum(axis=1) - count**2, 0.0),
        -2.0 * (whole - beam.likelihood[each, best]),
    )


def _split(beam: _Beam, command: Floats, tick: int, probability: float) -> _Beam:
    """Every hypothesis twice: the command of this tick arrives, or is lost."""
    arrived = beam._replace(
        current=np.broadcast_to(command, beam.current.shape), weight=beam.weight + np.log1p(-probability)
    )
    lost = beam.lost.copy()
    lost[:, :, tick] = True
    missed = beam._replace(
        weight=beam.weight + np.log(probability),
        first=beam.first + 1.0,
        second=beam.second + 2.0 * beam.first + 1.0,
        lost=lost,
    )
    return _Beam(*(np.concatenate(pair, axis=1) for pair in zip(arrived, missed, strict=True)))


def _merged(beam: _Beam, spread: Floats) -> _Beam:
    """The likeliest hypotheses, with those that are alike taken for one: `spread` (w, 2) is the state's uncertainty."""
    cell = _ALIKE * spread[:, None, :]
    # One number that differs where any of the three does.
    place = np.rint(beam.position / cell[..., 0]) + np.pi * np.rint(beam.velocity / cell[..., 1])
    key = place + np.e * 1e6 * beam.current
    order = np.lexsort((-beam.weight, key), axis=1)
    beam, key = beam.chosen(order), np.take_along_axis(key, order, 1)
    fresh = np.ones(key.shape, dtype=bool)
    fresh[:, 1:] = key[:, 1:] != key[:, :-1]
    group = (np.cumsum(fresh, axis=1) - 1 + np.arange(len(key))[:, None] * key.shape[1]).ravel()
    heads = np.maximum.accumulate(np.where(fresh, np.arange(key.shape[1]), 0), axis=1)
    relative = np.exp(beam.weight - np.take_along_axis(beam.weight, heads, 1))
    total = np.bincount(group, relative.ravel(), key.size)[group].reshape(key.shape)
    first = np.bincount(group, (relative * beam.first).ravel(), key.size)[group].reshape(key.shape) / total
    second = np.bincount(group, (relative * beam.second).ravel(), key.size)[group].reshape(key.shape) / total
    weight = np.where(fresh, beam.weight + np.log(total), _NONE)
    beam = beam._replace(weight=weight, first=first, second=second)
    kept = np.argsort(-weight, axis=1)[:, :_KEPT]
    beam = beam.chosen(kept)
    most = int((beam.weight > 0.5 * _NONE).sum(axis=1).max())
    return beam.chosen(np.broadcast_to(np.arange(most), (len(key), most)))
