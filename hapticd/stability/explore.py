"""What no theorem covers is explored: the whole loop, exactly, from thousands of starts.

A start is a place and a speed, and what the servo remembers: nothing, as when running begins; or that the shaft came at a
steady speed; or that it stood and was struck. Places and speeds are spread evenly (a Kronecker sequence, the same for every
loop) over the energies of all that the safety limits admit; where a motion is asked about, it is the first start, and the
others have at most its energy. Where β > λ theorem 2 takes from faster ones what they have more: whatever goes faster than
(q − σ)/(β − λ) in the mean loses energy, so that starts have at most three times that. A start

* is at rest when stiction holds whatever the loop may still command;
* buzzes when what it ends in stays below one tick: where Coulomb friction holds no tick (σ < ½) every motion ends so or
  worse (Fig. 8b); elsewhere it is the damper, the converter or the dither that does it. Not stable, and admitted, with
  the largest amplitude told;
* *moves on* when it grows, or when its cycle passes one tick;
* is undecided when its horizon ends before any of that. Who asks for an admission refuses it like one that moves on.

Work is counted in periods and not in seconds, so that the same question has the same answer on every machine. None of n
starts says that, of all starts drawn like these, fewer than 1 − 0.05^(1/n) move on, with 95 % confidence.

``hapticd simulate`` repeats a start that moves on. Effects of the plant that are no edits of its base are left out, but for
the lag of the amplifier; `Explored.approximate` names them.
"""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.effects import amplifier_lag
from hapticd.plant.lagged import parts_per_time
from hapticd.stability import sampled_loop as loops
from hapticd.stability.cycles import AT_REST, BUZZES, MOVES_ON, ONE_TICK, UNDECIDED, answers_of, growing, sorted_into
from hapticd.stability.numbers import Loop, loop_from_config
from hapticd.stability.starts import HEAVIEST, horizon, starts_of
from hapticd.stability.theorems import proof_of, uncovered
from hapticd.stability.whole_loop import LOOP, record_of

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.stability.cycles import Cycle

#: Ticks per period where no limit is set.
UNLIMITED: Final = 1e3
#: So many parts of a period behind a current loop take as long as a period without; and with a hand's stiffness too.
_PARTS, _HELD_PARTS = 16, 2
#: How far above what theorem 2 leaves the fastest start is, and so many ticks.
_BEYOND, _TICKS = 3.0, 10.0


@dataclass(frozen=True)
class Effort:
    """How much is tried.

    Attributes:
        starts: at most. periods: after which no further start begins; `least` starts run in any case.
        horizon: periods after which one start is undecided. batch: starts that are run together.
        until: amplitude in ticks of a cycle that is enough, undecided starts and growth included; None: all are run.
        motion_rests: whether it is enough, too, that the motion asked about does not come to rest.
    """

    starts: int
    periods: int
    horizon: int
    batch: int = 32
    least: int = 64
    until: float | None = None
    motion_rests: bool = False


#: About a second, and about 0.1 s of one core.
CHECK: Final = Effort(4096, 10_000_000, 200_000)
GUARD: Final = Effort(2048, 400_000, 40_000, batch=8, least=16, until=ONE_TICK)
#: What a change that is offered is checked with, and one draw of what is uncertain.
REMEDY: Final = Effort(256, 60_000, 15_000, batch=8, least=16, until=ONE_TICK)
DRAW: Final = Effort(32, 20_000, 20_000, batch=16, least=16, until=ONE_TICK)


_COUNTS: Final = ("starts", "at_rest", "buzzing", "moving_on", "undecided", "growing")


@dataclass(frozen=True)
class Explored:
    """What became of many starts.

    Attributes:
        starts: that were run. at_rest, buzzing, moving_on, undecided: what became of them. growing: of those that move on.
        longest: periods of the longest run.
        largest_cycle: amplitude in ticks of the largest oscillation that a start ended in; infinite where one grows.
        worst_start: place and speed (ticks, ticks per period) of a start that moves on, or else is undecided, or else
            buzzes; None where all rest. repeats: whether ``simulate`` repeats it, which begins with no memory;
            worst_periods: how long it takes to show.
        cycles: the oscillations that do not grow in which they end, the most frequent first.
        of_ticks: whether a buzz is what ticks alone make of this device.
        motion_rests: whether the motion asked about comes to rest; None without one.
        approximate: what the runs take differently from the device.
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
        """Whether none moved on, and none is undecided."""
        return self.moving_on == self.undecided == 0

    @property
    def bound(self) -> float:
        """The fraction of starts below which those that move on are with 95 % confidence, where none of these did."""
        return float(1.0 - 0.05 ** (1.0 / self.starts))

    @property
    def words(self) -> str:
        """One sentence without its stop."""
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
        """How ``hapticd simulate`` with the configuration's arguments shows the worst start; empty where it does not."""
        if self.worst_start is None or not self.repeats:
            return ""
        xi, xi_dot = self.worst_start
        said = [arguments] if arguments else []
        said += [f"--deflection {xi:.12g}"] if xi else []
        said += [f"--velocity {xi_dot:.12g}"] if xi_dot or not xi else []
        return f"hapticd simulate {' '.join(said)} --duration {max(1.0, 3.0 * self.worst_periods * period_s):.2g}"

    @property
    def ends(self) -> list[tuple[float, str, Cycle | None]]:
        """What the starts end in: share, what it is called, and the cycle if it is one."""
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


def explore(
    config: Config,
    latency_s: float = 0.0,
    *,
    loop: Loop | None = None,
    motion: tuple[float, float] | None = None,
    effort: Effort = CHECK,
    skip: int = 0,
    jobs: int | None = 1,
) -> Explored:
    """Run many starts of a configuration; the last answers are kept.

    Args:
        config: the configuration. latency_s: the driver's declared latency.
        loop: in its place, another loop of the same kind, in SI units.
        motion: place and speed of a motion, in ticks and ticks per period; None for all that the limits admit.
        effort: how much is tried. skip: starts that were run before.
        jobs: threads, None for one per core that this process may use; with 1 it runs in the thread that asks. The answer
            does not depend on it.
    """
    loop = loop or loop_from_config(config, latency_s)
    record = record_of(config, loop)
    left_out = [name for name in uncovered(config) if name != amplifier_lag.EFFECT.slug]
    approximate = [f"without plant.effects ({', '.join(left_out)})"] if left_out else []
    if len(left_out) < len(uncovered(config)) and config.amplifier.bandwidth_hz:
        approximate.insert(0, "the amplifier is the delay of (5) before amplifier_lag")
    reach, widest = admitted(config, loop, record, motion)
    found = explore_loop(record, reach, widest, motion=motion, effort=effort, skip=skip, jobs=jobs)
    return replace(found, approximate=tuple(approximate))


def explore_loop(
    record: NDArray[Any],
    reach: float,
    widest: float = math.inf,
    *,
    motion: tuple[float, float] | None = None,
    effort: Effort = CHECK,
    skip: int = 0,
    jobs: int | None = 1,
) -> Explored:
    """The same of a loop, (1,) of `LOOP`, from starts with as much energy as ``reach`` ticks at rest, and no wider."""
    return _explored(record.tobytes(), motion, reach, widest, effort, skip, jobs)


def admitted(
    config: Config, loop: Loop, record: NDArray[Any], motion: tuple[float, float] | None
) -> tuple[float, float]:
    """How far starts go: ticks at rest that have as much energy, and the widest place in ticks."""
    weight, widest = math.sqrt(min(float(record["mu"][0]), HEAVIEST)), math.inf
    if motion is None:
        limits = config.safety.max_velocity, config.safety.max_excursion
        reach = weight * (limits[0] * config.period / config.resolution if limits[0] else UNLIMITED)
        widest = limits[1] / config.resolution if limits[1] else math.inf
    else:
        reach = math.hypot(motion[0] * math.sqrt(1.0 + float(record["kappa"][0])), motion[1] * weight)
    proof = proof_of(config, loop)
    if proof is not None and proof.numbers.beta > proof.lam and math.isfinite(proof.top_speed(0.0)):
        faster = max(0.0, proof.q - proof.numbers.sigma) / (proof.numbers.beta - proof.lam)
        reach = min(reach, _BEYOND * (faster * weight + proof.q) + _TICKS)
    return reach, widest


@functools.lru_cache(maxsize=128)
def _explored(
    record: bytes,
    motion: tuple[float, float] | None,
    reach: float,
    widest: float,
    effort: Effort,
    skip: int,
    jobs: int | None,
) -> Explored:
    loop = np.frombuffer(record, LOOP)
    starts, runs, answers = [], [], []
    bare = loop.copy()
    for name in ("beta_v", "position_dither", "force_dither", "step"):
        bare[name] = 0.0
    of_ticks = not loops.can_rest(bare[0])
    each = 1
    if natural := float(loop["natural"][0]):
        each += math.ceil(parts_per_time(natural, 1.0) / (_HELD_PARTS if loop["kappa"][0] else _PARTS))
    spent, done, longest = 0, 0, horizon(loop, reach, effort.horizon)
    motion_rests: bool | None = None
    with threads(jobs) as run:
        while done < effort.starts and (spent < effort.periods or each * done < effort.least):
            # as many as there is likely to be time for, from what the starts before took
            left = (effort.periods - spent) * done // max(spent, 1) if done else 0
            first = _FEW if effort.until is not None and not done else effort.batch * _TOGETHER
            count = min(max(first, min(left, _AT_ONCE)), effort.starts - done)
            begun = starts_of(loop, motion, reach, widest, skip + done, count)
            ended = run(begun, longest, effort.batch if done == 0 else _AT_ONCE // 8)
            answer = answers_of(begun, ended)
            starts.append(begun)
            runs.append(ended)
            answers.append(answer)
            done += count
            spent += each * int(ended["periods"].sum())
            if motion is not None and done == count:
                motion_rests = skip > 0 or bool(answer[0] == AT_REST)
                if effort.motion_rests and not motion_rests:
                    break
            if (
                effort.until is not None
                and ((answer >= MOVES_ON) | ((answer == BUZZES) & (ended["amplitude"] >= effort.until))).any()
            ):
                break
    return _summary(np.concatenate(starts), np.concatenate(runs), np.concatenate(answers), of_ticks, motion_rests)


#: Starts that are run first where one that moves on is enough; batches before it is asked whether there is time for more;
#: most starts between two looks at the budget.
_FEW, _TOGETHER, _AT_ONCE = 4, 2, 256


@contextmanager
def threads(jobs: int | None) -> Iterator[Callable[[NDArray[Any], int, int], NDArray[Any]]]:
    """What runs (n,) starts, so many periods at most, so many starts at a time: in the thread that asks or in several.

    Args:
        jobs: threads; None for one per core that this process may use.
    """
    jobs = jobs or len(os.sched_getaffinity(0))
    with nullcontext() if jobs == 1 else ThreadPoolExecutor(jobs, thread_name_prefix="loops") as pool:
        mapped = map if pool is None else pool.map

        def run(begun: NDArray[Any], periods: int, batch: int) -> NDArray[Any]:
            parts = [begun[k : k + batch] for k in range(0, begun.size, batch)]
            return np.concatenate(list(mapped(lambda part: loops.run_loops(part, periods), parts)))

        yield run


def _summary(
    begun: NDArray[Any], runs: NDArray[Any], answers: NDArray[np.int8], of_ticks: bool, motion_rests: bool | None
) -> Explored:
    counted = np.bincount(answers, minlength=4)
    cycles = np.where(answers == AT_REST, 0.0, runs["amplitude"])
    grows = growing(runs)
    cycles[grows] = np.inf
    goes_on = runs[np.isin(answers, (BUZZES, MOVES_ON)) & ~grows]
    worst, repeats, periods = None, False, 0
    if counted[AT_REST] < answers.size:
        # of those that move on the largest, one that `simulate` can repeat before others
        rank = np.array([3, 2, 0, 1])[answers]
        rank[0] -= motion_rests is False  # the motion asked about before others like it
        order = np.lexsort((begun["known"], -cycles, rank))
        k = int(order[0])
        (worst, periods), repeats = ((float(begun["xi"][k]), float(begun["xi_dot"][k])), int(runs["periods"][k])), False
        if answers[k] == MOVES_ON or (answers[k] == BUZZES and not of_ticks):
            alike = order[:8][answers[order[:8]] == answers[k]]
            for place, found in _repeated(begun[alike], runs[alike], int(answers[k])):
                worst, repeats, periods = place, True, int(found["periods"])
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
    """Starts without memory, of few digits, that have the same answer: these, or places on the way of these."""
    for start, run in zip(begun, runs, strict=True):
        for xi, xi_dot in ((start["xi"], start["xi_dot"]), (run["xi"], run["xi_dot"])):
            if not (abs(xi) < 1e6 and math.isfinite(xi_dot)):
                continue
            place = float(f"{xi:.4g}"), float(f"{xi_dot:.4g}")
            again = start.reshape(1).copy()
            again["known"], again["phase"], again["clip"] = False, 0.0, np.inf
            again["xi"], again["xi_dot"] = place
            found = loops.run_loops(again, _REPEATED)
            if answers_of(again, found)[0] == answer:
                if found["reason"][0] == loops.ESCAPED:  # what is certain now has yet to show
                    again["search"] = 0
                    found = loops.run_loops(again, _REPEATED)
                yield place, found[0]


_REPEATED: Final = 20_000
