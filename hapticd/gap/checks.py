"""Checks of a recording before anything is fitted. Errors end the workflow; warnings are part of its result.

An error makes every result meaningless: no samples, no motion, time that decreases, values that are not finite, units wrong
by a factor of a thousand, an encoder counter that wrapped. A warning limits the conclusions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import uniform_filter1d

from hapticd.gap.errors import RecordingError

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.gap.arrays import Floats
    from hapticd.gap.recording import Recording

SHORTEST_S = 1.0
_SHORT_S = 5.0
_FEWEST = 200
_FEWEST_CELLS = 10.0
_ONE_WAY = 0.99
GAP_PERIODS = 10.0
_GAP_SHARE = 0.2
_SLOWEST_HZ, _FASTEST_HZ = 20.0, 100_000.0
_PEAK_FACTOR = 30.0
_BALANCE = 30.0
_FEWEST_STRIDES = 5
_AGAINST = 0.5
"""A sign is wrong if the cosine between the force that the model needs and the commanded one is below minus this."""
_NEEDED = 200.0
"""Ratio of needed to commanded force that no effect of the catalogue explains."""
_WRAPS = tuple(2.0**bits for bits in (8, 12, 14, 16, 20, 24, 32))
_WRAP_TOLERANCE = 0.1


def check_samples(name: str, time_s: Floats, position: Floats, current: Floats) -> None:
    """Refuse unusable samples: too few, not finite, or not in order of time.

    Raises:
        RecordingError: all errors, one per line.
    """
    problems = list(_sample_problems(time_s, position, current))
    if problems:
        raise RecordingError("\n".join(f"{name}: {problem}" for problem in problems))


def check_recording(recording: Recording, model: Config) -> tuple[str, ...]:
    """Warnings about a recording whose samples passed `check_samples`.

    Raises:
        RecordingError: all errors, one per line.
    """
    problems = [*_unit_errors(recording, model), *_wraps(recording, model), *_motionless(recording)]
    problems = problems or list(_undriven(recording, model))
    if problems:
        raise RecordingError("\n".join(f"{recording.name}: {problem}" for problem in problems))
    return tuple(f"{recording.name}: {warning}" for warning in _warnings(recording, model))


def check_together(recordings: Sequence[Recording]) -> None:
    """Refuse a recording that is given twice: it would count twice as evidence.

    Raises:
        RecordingError: two recordings are the same.
    """
    for one, other in combinations(recordings, 2):
        if np.array_equal(one.position, other.position) and np.array_equal(one.current, other.current):
            raise RecordingError(f"{one.name} and {other.name} are the same recording: name it once")


def _sample_problems(time_s: Floats, position: Floats, current: Floats) -> Iterator[str]:
    if time_s.size < _FEWEST:
        yield f"{time_s.size} samples are too few; at least {_FEWEST} are needed"
    for name, values in (("time_s", time_s), ("position", position), ("current", current)):
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            yield f"{name} is missing or not finite in {bad.size} row(s), first in row {bad[0]}"
    back = np.flatnonzero(np.diff(time_s) <= 0.0)
    if back.size:
        row = int(back[0]) + 1
        stamps = f"{time_s[row - 1]:.9g} s, then {time_s[row]:.9g} s"
        kind = "runs backwards or stops"
        yield f"the clock {kind} at {back.size} place(s), first at row {row} ({stamps})"


def _unit_errors(recording: Recording, model: Config) -> Iterator[str]:
    period, (unit, force_unit) = recording.period_s, ("m", "N") if recording.is_linear else ("rad", "N m")
    if period > 1.0 / _SLOWEST_HZ:
        likely = "ms" if period < 100.0 else "µs" if period < 1e5 else "ns"
        rate = f"{period:.4g} s between samples is {1.0 / period:.3g} Hz, slower than {_SLOWEST_HZ:g} Hz"
        yield f"time_s: {rate}; is it in {likely}? It must be in s"
    elif period < 1.0 / _FASTEST_HZ:
        rate = f"{period:.3g} s between samples is {1.0 / period:.3g} Hz, faster than {_FASTEST_HZ:g} Hz"
        yield f"time_s: {rate}; it must be in s"
    elif recording.duration_s < SHORTEST_S:
        yield f"{recording.duration_s:.3g} s are too short; at least {SHORTEST_S:g} s are needed"
    peak, largest = model.amplifier.peak_current, float(np.abs(recording.current).max())
    if peak is not None and largest > _PEAK_FACTOR * peak:
        limit = f"{largest / peak:.4g} times amplifier.peak_current = {peak:g} A of the model"
        yield f"the current reaches {largest:.4g} A, {limit}; is it in mA? It must be in A (a force in {force_unit})"
    steps = np.diff(recording.position)
    whole = np.array_equal(recording.position, np.rint(recording.position))
    if whole and float(np.ptp(recording.position)) > _FEWEST_CELLS and np.count_nonzero(steps) > _FEWEST_CELLS:
        yield f"position holds whole numbers only; are they counts? It must be in {unit} (or be called encoder_counts)"


def _wraps(recording: Recording, model: Config) -> Iterator[str]:
    """A counter overflow: one step as large as the counter's range, in which all positions lie, among much smaller steps."""
    if recording.resolution <= 0.0:
        return
    steps = np.diff(recording.position) / recording.resolution
    ranges = {*_WRAPS}
    if model.encoder.counts_per_rev is not None and not recording.is_linear:
        ranges.add(2.0 * np.pi / recording.resolution)
    travel = float(np.ptp(recording.position)) / recording.resolution
    for span in sorted(span for span in ranges if travel <= (1.0 + _WRAP_TOLERANCE) * span):
        for row in np.flatnonzero(np.abs(np.abs(steps) - span) < _WRAP_TOLERANCE * span):
            if float(np.median(np.abs(steps[max(row - 5, 0) : row + 6]))) < _WRAP_TOLERANCE * span:
                jump = f"jumps by {steps[row]:.0f} counts in one sample at row {row + 1}"
                size = span * recording.resolution
                other = (
                    f"{size:.6g} where it is in m"
                    if recording.is_linear
                    else f"{np.rad2deg(size):.6g} where it is in deg"
                )
                hint = f"import it with position.wrap: {span:.0f} where the map's unit is count, {other}"
                yield f"position {jump}: a counter that overflows at {span:.0f}; {hint}"
                return


def _motionless(recording: Recording) -> Iterator[str]:
    cell = recording.resolution
    span = float(np.ptp(recording.position))
    if span == 0.0 or (cell > 0.0 and span < _FEWEST_CELLS * cell):
        cells = f"{span / cell:.0f} encoder counts" if cell > 0.0 else "nothing"
        yield f"there is no motion: the position changes by {cells} in all; nothing can be concluded about forces"


def _undriven(recording: Recording, model: Config) -> Iterator[str]:
    """Motion that the command cannot cause, by orders of magnitude: a wrong column or unit, not a missing effect."""
    largest = float(np.abs(recording.current).max())
    ratio = _needed_over_commanded(recording, model)
    if largest == 0.0 and not _one_way(recording):
        yield (
            "the commanded current is 0 A in every row, and yet the shaft moves to and fro: is it the right column? "
            "Predictions start from the command, so nothing can be concluded"
        )
    elif largest > 0.0 and ratio > _NEEDED:
        unit, key = ("m", "counts_per_metre") if recording.is_linear else ("rad", "counts_per_rev")
        yield (
            f"the model would need {ratio:.3g} times the commanded force for this motion, more than {_NEEDED:g}: a unit is "
            f"wrong by a large factor, the position jumps, or the model is of another device. Position must be in {unit}, "
            f"or encoder_counts of encoder.{key} of the model; current in A"
        )


def _one_way(recording: Recording) -> str:
    """The direction of nearly all motion; empty if the shaft moves in both."""
    steps = np.diff(recording.position)
    forward, backward = float(steps[steps > 0.0].sum()), float(-steps[steps < 0.0].sum())
    if max(forward, backward) > _ONE_WAY * (forward + backward):
        return "positive" if forward > backward else "negative"
    return ""


def _warnings(recording: Recording, model: Config) -> Iterator[str]:
    if recording.duration_s < _SHORT_S:
        yield f"{recording.duration_s:.3g} s is short: small effects cannot be distinguished from chance; record 20 s"
    if way := _one_way(recording):
        yield (
            f"the motion goes in the {way} direction only: Coulomb friction, a constant bias and asymmetric friction "
            "cannot be distinguished"
        )
    if float(np.ptp(recording.current)) == 0.0:
        yield "the commanded current never changes: torque constant, delay and lag cannot be seen"
    yield from _gaps(recording)
    yield from _balance(recording, model)
    yield from _sign(recording, model)


def _gaps(recording: Recording) -> Iterator[str]:
    waits = np.diff(recording.time_s)
    gaps = np.flatnonzero(waits > GAP_PERIODS * recording.period_s)
    if gaps.size == 0:
        return
    missing = float(waits[gaps].sum())
    text = (
        f"{gaps.size} gap(s) of more than {GAP_PERIODS:g} periods, {missing:.3g} s in all, the longest "
        f"{waits.max():.3g} s at row {int(np.argmax(waits)) + 1}"
    )
    if missing > _GAP_SHARE * recording.duration_s:
        raise RecordingError(f"{recording.name}: {text}: more than {100 * _GAP_SHARE:.0f} % of the record is missing")
    yield f"{text}; what happened in them is not known"


def _balance(recording: Recording, model: Config) -> Iterator[str]:
    """Compare the force that the model needs with the commanded one: a factor of tens is a wrong unit, not friction."""
    ratio = _needed_over_commanded(recording, model)
    if ratio > _BALANCE:
        yield (
            f"the model would need {ratio:.3g} times the commanded force for this motion; is position in degrees or mm, "
            "or is the model of another device?"
        )
    elif ratio < 1.0 / _BALANCE:
        yield (
            f"the commanded force is {1.0 / ratio:.3g} times what the model needs for this motion; is the current in mA, "
            "or is the model of another device?"
        )


def _sign(recording: Recording, model: Config) -> Iterator[str]:
    needed = _needed(recording, model)
    commanded = uniform_filter1d(recording.current, _stride(recording))[:: _stride(recording)]
    if needed.size and float(needed @ commanded) < -_AGAINST * float(
        np.linalg.norm(needed) * np.linalg.norm(commanded)
    ):
        yield (
            "the shaft moves as if the current pushed the other way: is the sign of the current or of the position wrong "
            "(current.sign or position.sign of an import, encoder.invert of the model), or does a spring, a weight or a "
            "hand move it?"
        )


def _needed_over_commanded(recording: Recording, model: Config) -> float:
    """RMS of the force that the model needs for the motion, over the RMS of the commanded force; 1 without a command."""
    needed = _needed(recording, model)
    drive = model.amplifier.torque_constant * float(np.sqrt(np.mean(recording.current**2)))
    return max(float(np.sqrt(np.mean(needed**2))) / drive, 1e-9) if drive > 0.0 and needed.size else 1.0


def _stride(recording: Recording) -> int:
    return max(1, round(0.01 / recording.period_s))


def _needed(recording: Recording, model: Config) -> Floats:
    """Force that the model needs for the motion, every 10 ms; empty if the sampling rate is too low for that.

    Over 10 ms the motion is well above the encoder's noise. The result is right to an order of magnitude only.
    """
    stride = _stride(recording)
    position, time_s = recording.position[::stride], recording.time_s[::stride]
    if position.size < _FEWEST_STRIDES:
        return np.zeros(0)
    velocity = np.gradient(position, time_s)
    plant = model.plant
    return np.asarray(
        plant.inertia * np.gradient(velocity, time_s) + plant.viscous * velocity + plant.coulomb * np.sign(velocity)
    )
