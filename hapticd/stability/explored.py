"""Result of an exploration (`hapticd.stability.explore`): counts, cycles, worst start, and its text and document."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.stability import sampled_loop as loops
from hapticd.stability.cycles import (
    AT_REST,
    BUZZES,
    MOVES_ON,
    UNDECIDED,
    Cycle,
    answers_of,
    growing,
    sorted_into,
)

_COUNTS: Final = ("starts", "at_rest", "buzzing", "moving_on", "undecided", "growing")
#: Horizon in periods of a repeated start.
_REPEATED: Final = 20_000


@dataclass(frozen=True)
class Explored:
    """Result of an exploration.

    Attributes:
        starts: number run. at_rest, buzzing, moving_on, undecided: number of each. growing: of those that move on.
        longest: periods of the longest run.
        largest_cycle: amplitude in ticks of the largest final oscillation; infinite if one grows.
        worst_start: position and velocity (ticks, ticks per period) of a start that moves on, or else is undecided, or else
            buzzes; None if all rest. repeats: whether ``simulate``, which starts with empty memory, repeats it.
            worst_periods: how long that takes.
        cycles: the final oscillations that do not grow, the most frequent first.
        of_ticks: whether quantisation alone makes this device buzz.
        motion_rests: whether the requested motion comes to rest; None without one.
        approximate: differences between the simulation and the device.
    """

    starts: int
    at_rest: int
    buzzing: int
    moving_on: int
    undecided: int
    growing: int
    longest: int
    largest_cycle: float
    worst_start: tuple[float, float] | None
    repeats: bool
    worst_periods: int
    of_ticks: bool
    motion_rests: bool | None
    approximate: tuple[str, ...] = ()
    cycles: tuple[Cycle, ...] = ()

    @property
    def stable(self) -> bool:
        """Whether all came to rest."""
        return self.at_rest == self.starts

    @property
    def admissible(self) -> bool:
        """Whether none moves on, and none is undecided."""
        return self.moving_on == self.undecided == 0

    @property
    def bound(self) -> float:
        """Upper bound of the fraction of starts that move on, with 95 % confidence, if none of these did."""
        return float(1.0 - 0.05 ** (1.0 / self.starts))

    @property
    def words(self) -> str:
        """The result as one sentence without full stop."""
        if self.moving_on or self.undecided:
            parts = []
            if self.moving_on:
                how = (
                    f"{self.growing:,} of them growing"
                    if self.growing
                    else f"with up to {self.largest_cycle:.3g} ticks"
                )
                parts.append(f"{self.moving_on:,} of {self.starts:,} starts moved on, {how}")
            if self.undecided:
                parts.append(
                    f"{self.undecided:,} of {self.starts:,} starts were undecided after {self.longest:,} periods"
                )
            return "; ".join(parts)
        text = (
            f"none of {self.starts:,} starts moved on: fewer than {100.0 * self.bound:.2g} % do, with 95 % confidence"
        )
        if self.buzzing:
            share = "" if self.at_rest else "all "
            text += f"; {share}{self.buzzing:,} end in a buzz of up to {self.largest_cycle:.2g} ticks"
            text += "" if self.of_ticks else ", though Coulomb friction could hold the ticks"
        return text

    def command(self, period_s: float, arguments: str = "") -> str:
        """The ``hapticd simulate`` command that shows the worst start; empty if it cannot."""
        if self.worst_start is None or not self.repeats:
            return ""
        xi, xi_dot = self.worst_start
        said = [arguments] if arguments else []
        said += [f"--deflection {xi:.12g}"] if xi else []
        said += [f"--velocity {xi_dot:.12g}"] if xi_dot or not xi else []
        return f"hapticd simulate {' '.join(said)} --duration {max(1.0, 3.0 * self.worst_periods * period_s):.2g}"

    @property
    def ends(self) -> list[tuple[float, str, Cycle | None]]:
        """The final states of the starts: share, name, and the cycle if it is one."""
        others = (self.at_rest, "rest"), (self.growing, "growth"), (self.undecided, "undecided")
        told: list[tuple[float, str, Cycle | None]] = [(n / self.starts, name, None) for n, name in others if n]
        return told + [(cycle.share, cycle.words, cycle) for cycle in self.cycles]

    @property
    def document(self) -> dict[str, Any]:
        """The key ``explored`` of ``hapticd check --json``."""
        told: dict[str, Any] = {name: getattr(self, name) for name in _COUNTS}
        told["bound_95"] = self.bound if self.moving_on == 0 else None
        told |= {name: getattr(self, name) for name in ("longest", "largest_cycle")}
        keys = "position_ticks", "velocity_ticks_per_period"
        told["worst_start"] = self.worst_start and dict(zip(keys, self.worst_start, strict=True))
        told |= {"repeats": self.repeats, "cycles": [asdict(cycle) for cycle in self.cycles]}
        return told | {"approximate": list(self.approximate), "words": self.words}


def summary(
    begun: NDArray[Any], runs: NDArray[Any], answers: NDArray[np.int8], of_ticks: bool, motion_rests: bool | None
) -> Explored:
    """The result of n starts.

    Args:
        begun: (n,) of `LOOP`, the starts. runs: (n,) of `RUN`. answers: (n,) from `answers_of`.
        of_ticks: whether quantisation alone makes the device buzz. motion_rests: see `Explored`.
    """
    counted = np.bincount(answers, minlength=4)
    cycles = np.where(answers == AT_REST, 0.0, runs["amplitude"])
    grows = growing(runs)
    cycles[grows] = np.inf
    goes_on = runs[np.isin(answers, (BUZZES, MOVES_ON)) & ~grows]
    worst, repeats, periods = None, False, 0
    if counted[AT_REST] < answers.size:
        # of those that move on, the largest; those that `simulate` can repeat come first
        rank = np.array([3, 2, 0, 1])[answers]
        rank[0] -= motion_rests is False  # the requested motion before others like it
        order = np.lexsort((begun["known"], -cycles, rank))
        k = int(order[0])
        (worst, periods), repeats = ((float(begun["xi"][k]), float(begun["xi_dot"][k])), int(runs["periods"][k])), False
        if answers[k] == MOVES_ON or (answers[k] == BUZZES and not of_ticks):
            alike = order[:8][answers[order[:8]] == answers[k]]
            for state, found in _repeated(begun[alike], runs[alike], int(answers[k])):
                worst, repeats, periods = state, True, int(found["periods"])
                break
    return Explored(
        starts=answers.size,
        at_rest=int(counted[AT_REST]),
        buzzing=int(counted[BUZZES]),
        moving_on=int(counted[MOVES_ON]),
        undecided=int(counted[UNDECIDED]),
        growing=int(grows.sum()),
        longest=int(runs["periods"].max()),
        largest_cycle=float(cycles.max()),
        worst_start=worst,
        repeats=repeats,
        worst_periods=periods,
        of_ticks=of_ticks,
        motion_rests=motion_rests,
        cycles=tuple(
            replace(cycle, share=cycle.share * goes_on.size / answers.size) for cycle in sorted_into(goes_on)[0]
        ),
    )


def _repeated(begun: NDArray[Any], runs: NDArray[Any], answer: int) -> Iterator[tuple[tuple[float, float], Any]]:
    """Starts without memory, of few digits, with the same result: these, or states on their trajectories."""
    for start, run in zip(begun, runs, strict=True):
        for xi, xi_dot in ((start["xi"], start["xi_dot"]), (run["xi"], run["xi_dot"])):
            if not (abs(xi) < 1e6 and math.isfinite(xi_dot)):
                continue
            state = float(f"{xi:.4g}"), float(f"{xi_dot:.4g}")
            again = start.reshape(1).copy()
            again["known"], again["phase"], again["clip"] = False, 0.0, np.inf
            again["xi"], again["xi_dot"] = state
            found = loops.run_loops(again, _REPEATED)
            if answers_of(again, found)[0] == answer:
                if found["reason"][0] == loops.ESCAPED:  # growth is certain, but not yet visible
                    again["search"] = 0
                    found = loops.run_loops(again, _REPEATED)
                yield state, found[0]
