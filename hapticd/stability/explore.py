"""Exploration of a loop that no theorem covers: exact simulation of the whole loop from thousands of starts.

A start is a position, a velocity and the servo's memory: empty, as when running begins; of a shaft that moved at constant
velocity; or of a shaft at rest that got an impulse. Positions and velocities are spread evenly (a Kronecker sequence, the
same for every loop) over all energies that the safety limits admit. A requested motion is the first start, and the others
have at most its energy. If β > λ, by theorem 2 every motion with a mean speed above (q − σ)/(β − λ) loses energy, so that
starts have at most three times that speed. A start

* is at rest when stiction holds every force that the loop may still command;
* buzzes when its final oscillation stays below one tick: if Coulomb friction cannot hold one tick (σ < ½) no motion comes to
  rest (Fig. 8b); otherwise the damper, the converter or the dither causes it. Not stable, but admitted, with the largest
  amplitude reported;
* *moves on* when it grows, or when its cycle exceeds one tick;
* is undecided when its horizon ends before that. The guard refuses it like one that moves on.

The work is limited in periods, not in seconds, so that every machine gives the same result. If none of n starts moves on,
fewer than 1 − 0.05^(1/n) of all starts drawn like these do, with 95 % confidence.

``hapticd simulate`` repeats a start that moves on. Effects of the plant that do not only edit its base parameters are left
out, except the lag of the amplifier; `Explored.approximate` names them.
"""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.effects import amplifier_lag
from hapticd.plant.lagged import parts_per_time
from hapticd.stability import sampled_loop as loops
from hapticd.stability.cycles import AT_REST, BUZZES, MOVES_ON, ONE_TICK, answers_of
from hapticd.stability.explored import Explored, summary
from hapticd.stability.numbers import Loop, loop_from_config
from hapticd.stability.starts import HEAVIEST, horizon, starts_of
from hapticd.stability.theorems import proof_of, uncovered
from hapticd.stability.whole_loop import LOOP, record_of

if TYPE_CHECKING:
    from hapticd.config import Config

#: Largest speed in ticks per period if no limit is set.
UNLIMITED: Final = 1e3
#: Parts of a period behind a current loop that cost as much as a period without one; the second with a hand's stiffness.
_PARTS, _HELD_PARTS = 16, 2
#: Fastest start: a multiple of the speed from theorem 2, plus a number of ticks.
_BEYOND, _TICKS = 3.0, 10.0


@dataclass(frozen=True)
class Effort:
    """Amount of work.

    Attributes:
        starts: at most. periods: total after which no further start begins. least: starts that always run.
        horizon: periods after which one start is undecided. batch: starts that run together.
        until: amplitude in ticks of a cycle that ends the exploration, as growth or an undecided start does; None: all run.
        motion_rests: whether it also ends if the requested motion does not come to rest.
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
#: For a proposed change, and for one draw of an uncertain plant.
REMEDY: Final = Effort(256, 60_000, 15_000, batch=8, least=16, until=ONE_TICK)
DRAW: Final = Effort(32, 20_000, 20_000, batch=16, least=16, until=ONE_TICK)


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
    """Run many starts of a configuration; the last results are cached.

    Args:
        config: the configuration. latency_s: the driver's declared latency.
        loop: instead of the configuration's, another loop of the same kind, in SI units.
        motion: position and velocity of a motion, in ticks and ticks per period; None for all that the limits admit.
        effort: amount of work. skip: starts that were run before.
        jobs: threads, None for one per core that this process may use; 1: in the calling thread. The result
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
    """Explore a loop, (1,) of `LOOP`, from starts with at most the energy of ``reach`` ticks at rest, within ±``widest``."""
    return explored_record(record.tobytes(), motion, reach, widest, effort, skip, jobs)


def admitted(
    config: Config, loop: Loop, record: NDArray[Any], motion: tuple[float, float] | None
) -> tuple[float, float]:
    """Limits of the starts: deflection at rest with their largest energy, and largest position; in ticks."""
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
def explored_record(
    record: bytes,
    motion: tuple[float, float] | None,
    reach: float,
    widest: float,
    effort: Effort,
    skip: int,
    jobs: int | None,
) -> Explored:
    """`explore_loop` of a loop's bytes, of which the last results are kept."""
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
            # as many as the remaining budget allows, estimated from the starts before
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
    return summary(np.concatenate(starts), np.concatenate(runs), np.concatenate(answers), of_ticks, motion_rests)


#: Starts of the first group if one that moves on ends the exploration; batches between two checks of the budget;
#: most starts between two checks.
_FEW, _TOGETHER, _AT_ONCE = 4, 2, 256


@contextmanager
def threads(jobs: int | None) -> Iterator[Callable[[NDArray[Any], int, int], NDArray[Any]]]:
    """A function that runs (n,) starts, with a limit of periods and a batch size: in the calling thread or in several.

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
