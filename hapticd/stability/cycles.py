"""What a start ends in, by exact simulation: at rest, in a cycle of some kind, or in growth.

A cycle that *recurs* is symmetric, one swing of two equal halves, or asymmetric: one half longer than the other, or several
swings that are not alike. One that *wanders* has settled in how far it goes (1 %), and does not recur: its swings beat with
the servo's periods for ever, or chance from a uniform dither drives it. Some of these are on their way to a cycle still.

Below one tick the bare spring is a relay that switches at samples, and a symmetric cycle takes a whole number of periods,
usually one of several. All starts that end in the same have the same amplitude, at places that differ: where a cycle lies
within its tick hardly matters to it.
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
#: Ticks below which an oscillation that rises a little is no growth yet.
_SMALL: Final = 0.5
AT_REST, BUZZES, MOVES_ON, UNDECIDED = range(4)

Kind = Literal["symmetric", "asymmetric", "wandering"]
WANDERS: Final = "wandering"
_KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
#: Above one tick, cycles whose amplitudes are within one of so many steps to twice as much are told as one.
_STEPS: Final = 2.0
#: Mean force in ticks below which both halves of a swing are as long.
_EQUAL: Final = 1e-9


@dataclass(frozen=True)
class Cycle:
    """Oscillations of one kind in which starts end: of one frequency if they recur, of about one amplitude above one tick.

    Attributes:
        share: of the starts. kind: see above.
        periods: of the servo that one swing takes, rounded; 0 where no swing was seen whole.
        amplitude: of the largest, ticks. median: of their amplitudes.
        centre: of the farthest from the origin, the middle of where it goes, ticks.
    """

    share: float
    kind: Kind
    periods: int
    amplitude: float
    median: float
    centre: float

    @property
    def words(self) -> str:
        """What it is called: its periods, its kind where it is not symmetric, and whether it passes one tick."""
        name = WANDERS if self.kind == WANDERS else f"{self.periods} periods"
        return name + (self.kind == "asymmetric") * ", uneven" + (self.amplitude >= ONE_TICK) * ", above a tick"


#: Quarters of a horizon for which a rise from its third to its last is thought to go on.
_FURTHER: Final = 40


def answers_of(begun: NDArray[Any], runs: NDArray[Any]) -> NDArray[np.int8]:
    """AT_REST … UNDECIDED of each run; (n,) of `LOOP` and of `RUN`."""
    reason, amplitude, outcome = runs["reason"], runs["amplitude"], runs["outcome"]
    chance = (begun["waveform"] == UNIFORM) & (reason != loops.REST)
    rests = np.isin(reason, (loops.REST, loops.VANISHED)) | ((amplitude < loops.CREEP) & ~chance)
    grows, goes_on = growing(runs), outcome == PERSISTENT
    # what has neither recurred nor settled below a tick may grow very slowly, where nothing forbids it
    unsettled = (reason == loops.HORIZON) & (amplitude < ONE_TICK) & ~chance & ~rests & ~grows
    unsettled[unsettled] = ~never_grows(begun[unsettled])
    # a damper's cycles wander, and what the delay of a current loop forbids its second order hardly does: it takes a rise
    # that would lead beyond a tick
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
    """The cycles in which runs end that neither rest nor grow.

    Returns:
        The cycles, the most frequent first, with their share of these runs; and (n,) which of them a run is in.
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
    """The share of starts that end in cycles whose median amplitude a prediction meets, to a fraction of it."""
    return sum(cycle.share for cycle in cycles if abs(amplitude / cycle.median - 1.0) <= tolerance)
