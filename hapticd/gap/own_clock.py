"""Positions that a device samples with a clock of its own and holds until its next sample.

A recorder with another period gets positions of an age between 0 and the device's period P, a sawtooth in time:

    x_k = θ(t_k − a_k),  a_k = (t_k − t_0) mod P

The age times the velocity would be taken for a force at the beat of both clocks. In third differences the motion itself is
small: there the beat and its harmonics are lines, and the sawtooth must explain most, with a factor near one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from hapticd.gap.parallel import one_blas_thread

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.gap.arrays import Floats

_ROWS: Final = 200, 6000
"""Least number of samples, and number of those in which a clock is looked for: where the shaft moves most."""
_REGULAR: Final = 0.01
"""Largest difference of two waits for a sample, over their median: a sample that is late moves as a stale one does."""
_ORDER: Final = 3
_AROUND: Final = 4
"""The velocity is the mean over so many periods before and after a sample."""
_SLOWEST: Final = 0.03
"""Least beat, in cycles per period: below it the motion itself is not small."""
_LINES, _BESIDE, _HARMONICS = 4, 30, 12
"""Lines that are tried as the beat, the points of the spectrum at each side that belong to a line, harmonics of a beat."""
_SHORTEST, _LONGEST = 0.5, 2.0
"""Periods of the device's clock that are looked for, in periods of the recorder."""
_LEAST_SHARE, _FIRST_SHARE = 0.5, 0.2
"""Least share of the third differences' power that the age explains: in the end, and with a first phase."""
_PHASES: Final = np.arange(0.0, 1.0, 1.0 / 48.0)
_NEAR_ONE: Final = 0.25
"""Largest deviation from 1 of the factor with which the age explains them."""
_CELLS: Final = 1.5
"""Least motion in a period of the clock, in counts: at a constant speed the encoder's own steps are a sawtooth of one."""
_UNSURE: Final = 0.01
"""Age, and time to the device's next sample, in its periods, below which it is not sure which sample a row has."""


class OwnClock(NamedTuple):
    """A device's clock.

    Attributes:
        period_s: P. sampled_s: time of one of its samples.
        share: share of the power of third differences of the position that the age explains. factor: of the age in them.
    """

    period_s: float
    sampled_s: float
    share: float = 0.0
    factor: float = 0.0

    def age_s(self, time_s: Floats) -> Floats:
        """(n,) age of the position at some times [s]."""
        return np.asarray(np.mod(time_s - self.sampled_s, self.period_s))

    def described(self, recorder_s: float) -> str:
        """What it means for a record with that period [s], in words."""
        return (
            f"the positions have a clock of their own, with a period of {1e3 * self.period_s:.4g} ms "
            f"({self.period_s / recorder_s:.3f} of the record's): the record is used at the times of its samples"
        )


class _Part(NamedTuple):
    """Samples in a row: times, velocities, and third differences of the position."""

    time_s: Floats
    velocity: Floats
    bends: Floats

    def scored(self, period_s: float, sampled_s: float) -> OwnClock:
        """A clock with its share and factor here; a share of 0 if the factor is far from 1."""
        age = -np.diff(OwnClock(period_s, sampled_s).age_s(self.time_s) * self.velocity, _ORDER)
        product, power = float(age @ self.bends), max(float(age @ age), 1e-300)
        factor = product / power
        share = factor * product / float(self.bends @ self.bends)
        return OwnClock(period_s, sampled_s, share if abs(factor - 1.0) < 2.0 * _NEAR_ONE else 0.0, factor)

    def periodic(self, rate_hz: float) -> float:
        """Share of the third differences' power that any periodic age explains."""
        turns = 2.0 * np.pi * np.multiply.outer(np.arange(1.0, 1.0 + _HARMONICS), rate_hz * self.time_s)
        columns = np.diff(np.concatenate([np.sin(turns), np.cos(turns)]) * self.velocity, _ORDER)
        H, g = columns @ columns.T, columns @ self.bends
        H += 1e-9 * np.trace(H) * np.eye(len(H))
        return float(g @ np.linalg.solve(H, g)) / float(self.bends @ self.bends)

    def nearest(self, found: OwnClock, step: float) -> OwnClock:
        """The best clock near one, with the phase and the turns over these samples changed by some steps."""
        duration_s, steps = float(np.ptp(self.time_s)), step * np.arange(-3.0, 4.0)
        periods = [1.0 / (1.0 / found.period_s + turns / duration_s) for turns in steps]
        times = [found.sampled_s + phase * found.period_s for phase in steps]
        return max((self.scored(P, time_s) for P in periods for time_s in times), key=lambda one: one.share)


@one_blas_thread
def own_clock(time_s: Floats, position: Floats, resolution: float) -> OwnClock | None:
    """The device's own clock, if the positions show one.

    Args:
        time_s: (n,) times of the samples [s]. position: (n,) in any unit. resolution: one count, in the same unit.
    """
    waits = np.diff(time_s)
    if time_s.size < _ROWS[0] or np.ptp(waits) > _REGULAR * float(np.median(waits)):
        return None
    velocity = _velocity(time_s, position)
    moved = np.concatenate([[0.0], np.cumsum(velocity**2)])
    rows = min(_ROWS[1], time_s.size)
    first = int(np.argmax(moved[rows:] - moved[:-rows]))

    def part(first: int, last: int) -> _Part:
        return _Part(time_s[first:last], velocity[first:last], np.diff(position[first:last], _ORDER))

    found = _first_clock(part(first, first + rows), float(np.median(waits)))
    if (
        found is None
        or found.period_s * float(np.sqrt(np.mean(velocity[first : first + rows] ** 2))) < _CELLS * resolution
    ):
        return None
    last = first + rows
    while True:
        own = part(first, last)
        for step in (0.1, 0.03, 0.01, 0.003, 0.001):
            found = own.nearest(found, step)
        if (first, last) == (0, time_s.size):
            break
        first, last = max(first - rows, 0), min(last + rows, time_s.size)
        rows *= 2
    return found if found.share > _LEAST_SHARE and abs(found.factor - 1.0) < _NEAR_ONE else None


class Resampled(NamedTuple):
    """A record at the times of the device's samples.

    Attributes:
        rows: (m,) which rows are the first that surely have a sample of the device.
        time_s: (m,) when the device took it [s]. current: (m,) mean of the recorded current until its next one [A].
    """

    rows: NDArray[np.int64]
    time_s: Floats
    current: Floats


def at_the_samples(time_s: Floats, current: Floats, clock: OwnClock) -> Resampled:
    """The record at the times of the device's samples: positions stay what was measured, the current is held by its stamps.

    Args:
        time_s: (n,) stamps [s]. current: (n,) held from each stamp to the next one [A]. clock: of the positions.
    """
    age_s = clock.age_s(time_s)
    sure = np.flatnonzero(np.minimum(age_s, clock.period_s - age_s) > _UNSURE * clock.period_s)
    sample = np.rint((time_s - age_s - clock.sampled_s)[sure] / clock.period_s)
    sample, first = np.unique(sample, return_index=True)
    taken_s = sample * clock.period_s + clock.sampled_s
    ends_s = np.append(taken_s[1:], taken_s[-1] + clock.period_s)
    stamps = np.concatenate([[min(taken_s[0], time_s[0])], time_s[1:], [max(ends_s[-1], time_s[-1])]])
    charge = np.concatenate([[0.0], np.cumsum(current * np.diff(stamps))])
    mean = (np.interp(ends_s, stamps, charge) - np.interp(taken_s, stamps, charge)) / (ends_s - taken_s)
    return Resampled(sure[first], taken_s, mean)


def _first_clock(part: _Part, period_s: float) -> OwnClock | None:
    """A clock with a first phase; of several rates with the same beat, the one that explains most."""
    if not np.any(part.bends):
        return None
    duration_s, middle_s = float(np.ptp(part.time_s)), float(np.mean(part.time_s))
    lines = _lines(part, period_s)

    def near_lines(turns: Floats, least: float) -> list[tuple[float, float]]:
        """Shares that beats near the lines explain, and these beats, from a least share."""
        found = [(part.periodic(beat_hz), beat_hz) for line in lines for beat_hz in line + turns / duration_s]
        return [one for one in found if one[0] > least]

    if not near_lines(np.linspace(-0.25, 0.25, 3), 0.5 * _FIRST_SHARE):
        return None
    beats = near_lines(np.linspace(-1.0, 1.0, 17), _FIRST_SHARE)
    if not beats:
        return None
    _, beat_hz = max(beats)
    periods = {1.0 / abs(whole / period_s + sign * beat_hz) for whole in range(3) for sign in (1.0, -1.0)}
    tried = (
        max((part.scored(P, middle_s + phase * P) for phase in _PHASES), key=lambda one: one.share)
        for P in periods
        if _SHORTEST < P / period_s < _LONGEST
    )
    return max((part.nearest(part.nearest(one, 0.1), 0.03) for one in tried), key=lambda one: one.share)


def _velocity(time_s: Floats, position: Floats) -> Floats:
    row = np.arange(time_s.size)
    first, last = np.maximum(row - _AROUND, 0), np.minimum(row + _AROUND, time_s.size - 1)
    return np.asarray((position[last] - position[first]) / (time_s[last] - time_s[first]))


def _lines(part: _Part, period_s: float) -> list[float]:
    """The strongest lines [Hz] of third differences times the velocity; the noise of the position is made white."""
    product = part.bends * part.velocity[1 : 1 - _ORDER]
    size = 2 * product.size
    cycles = np.fft.rfftfreq(size)
    swing = (
        np.abs(np.fft.rfft(product - product.mean(), size)) / np.maximum(2.0 * np.sin(np.pi * cycles), 1e-3) ** _ORDER
    )
    swing[cycles < _SLOWEST] = 0.0
    found = []
    for _ in range(_LINES):
        line = int(np.argmax(swing))
        found.append(float(cycles[line]) / period_s)
        swing[max(line - _BESIDE, 0) : line + _BESIDE + 1] = 0.0
    return found
