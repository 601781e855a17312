"""Final state of a motion, by exact simulation: rest, a cycle, or growth.

A cycle that *recurs* is symmetric (one oscillation of two equal halves) or asymmetric (halves of different length, or
several different oscillations). A *wandering* one has a settled amplitude (within 1 %) and does not recur: its frequency is
not a fraction of the servo rate, or a uniform dither drives it. Some of these have not yet converged to a cycle.

Below one tick the bare spring is a relay that switches at samples, and a symmetric cycle lasts a whole number of periods.
Several numbers are usually possible. Starts that end in the same cycle have the same amplitude at different positions: the
cycle hardly depends on its position within the tick.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from hapticd.stability import sampled_loop as loops
from hapticd.stability.criterion import lambda_
from hapticd.stability.escape import never_grows
from hapticd.stability.outcome import GROWING, PERSISTENT, STRETCHES
from hapticd.stability.whole_loop import UNIFORM

ONE_TICK: Final = 1.0
#: Amplitude in ticks below which a small rise does not count as growth.
_SMALL: Final = 0.5
AT_REST, BUZZES, MOVES_ON, UNDECIDED = range(4)

Kind = Literal["symmetric", "asymmetric", "wandering"]
WANDERS: Final = "wandering"
_KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
#: Steps per octave of amplitude: cycles above one tick within one step are reported as one.
_STEPS: Final = 2.0
#: Mean force in ticks below which both halves of an oscillation count as equally long.
_EQUAL: Final = 1e-9


@dataclass(frozen=True)
class Cycle:
    """Final oscillations of one kind: of one frequency if they recur; above one tick, of about one amplitude.

    Attributes:
        share: of the starts. kind: see the module.
        periods: servo periods of one oscillation, rounded; 0 if none was complete.
        amplitude: of the largest, ticks. median: of their amplitudes.
        centre: of the one farthest from the origin, middle of its range, ticks.
    """

    share: float
    kind: Kind
    periods: int
    amplitude: float
    median: float
    centre: float

    @property
    def words(self) -> str:
        """Its name: its periods, its kind if not symmetric, and whether it exceeds one tick."""
        name = WANDERS if self.kind == WANDERS else f"{self.periods} periods"
        return name + (self.kind == "asymmetric") * ", uneven" + (self.amplitude >= ONE_TICK) * ", above a tick"


#: Quarters of a horizon over which a rise from its third to its last quarter is extrapolated.
_FURTHER: Final = 40


def answers_of(begun: NDArray[Any], runs: NDArray[Any]) -> NDArray[np.int8]:
    """AT_REST … UNDECIDED of each run; (n,) of `LOOP` and of `RUN`."""
    reason, amplitude, outcome = runs["reason"], runs["amplitude"], runs["outcome"]
    chance = (begun["waveform"] == UNIFORM) & (reason != loops.REST)
    rests = np.isin(reason, (loops.REST, loops.VANISHED)) | ((amplitude < loops.CREEP) & ~chance)
    grows, goes_on = growing(runs), outcome == PERSISTENT
    # a run that has neither recurred nor settled below a tick may grow very slowly, unless that is excluded
    unsettled = (reason == loops.HORIZON) & (amplitude < ONE_TICK) & ~chance & ~rests & ~grows
    unsettled[unsettled] = ~never_grows(begun[unsettled])
    # cycles of a damper wander, and with a second-order current loop growth is hardly possible: only a rise counts
    # that would lead beyond one tick
    late = begun["tau_d"] + 2.0 * begun["ratio"] / np.where(begun["natural"] > 0.0, begun["natural"], np.inf)
    bounded = (begun["beta_v"] > 0.0) | ((begun["natural"] > 0.0) & (begun["beta"] > lambda_(late)))
    half = STRETCHES // 2
    earlier, later = runs["peaks"][:, :half].max(axis=1), runs["peaks"][:, half:].max(axis=1)
    rise = np.sqrt(np.divide(later, earlier, out=np.ones(runs.size), where=earlier > 0.0))
    unsettled &= ~bounded | (amplitude * rise**_FURTHER >= ONE_TICK)
    found = np.select(
        [rests & ~grows, grows, (amplitude < ONE_TICK) & ~unsettled, goes_on & ~unsettled],
        [AT_REST, MOVES_ON, BUZZES, MOVES_ON],
        UNDECIDED,
    )
    return found.astype(np.int8)


def growing(runs: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether a run grows."""
    return np.asarray((runs["outcome"] == GROWING) & (runs["amplitude"] >= _SMALL))


def sorted_into(runs: NDArray[Any]) -> tuple[list[Cycle], NDArray[np.int64]]:
    """The cycles of those runs that neither rest nor grow.

    Returns:
        The cycles, the most frequent first, with their share of these runs; and (n,) the index of each run's cycle.
    """
    swing = np.divide(2.0 * math.pi, runs["omega"], out=np.zeros(runs.size), where=runs["omega"] > 0.0)
    even = (np.abs(runs["cycle"] - swing) < 0.5) & (np.abs(runs["lean"]) < _EQUAL)
    recurs = runs["cycle"] > 0
    kind = np.where(recurs, np.where(even, 0, 1), _KINDS.index(WANDERS))
    periods = np.where(recurs, np.rint(swing), 0.0)
    size = np.rint(_STEPS * np.log2(np.maximum(runs["amplitude"], ONE_TICK)))
    _, place, counts = np.unique(
        np.column_stack((kind, periods, size)), axis=0, return_inverse=True, return_counts=True
    )
    order = np.argsort(-counts, kind="stable")
    which = np.argsort(order)[place.ravel()]
    cycles = []
    for number in range(order.size):
        alike = which == number
        centre = runs["centre"][alike]
        cycles.append(
            Cycle(
                share=float(alike.mean()),
                kind=_KINDS[kind[alike][0]],
                periods=round(float(np.median(swing[alike]))),
                amplitude=float(runs["amplitude"][alike].max()),
                median=float(np.median(runs["amplitude"][alike])),
                centre=float(centre[np.argmax(np.abs(centre))]),
            )
        )
    return cycles, which


def within(cycles: Sequence[Cycle], amplitude: float, tolerance: float) -> float:
    """The share of starts in cycles whose median amplitude agrees with a prediction, within a relative tolerance."""
    return sum(cycle.share for cycle in cycles if abs(amplitude / cycle.median - 1.0) <= tolerance)
