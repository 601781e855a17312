"""The loop with all that the servo renders, exactly, from sample to sample: where no theorem covers it, this runs it.

Beyond `hapticd.stability.map_kernel`, which is the bare spring of eq. 7–9: virtual damping with its velocity estimate, a
spring without ticks (φ = −ξ), a hand's stiffness κ, and the passivity controller (`hapticd.stability.passivity`), for which
the whole delay is T_V: it knows when a command is sent. Numbers are those of Table I. A run ends

* at rest: the mass has stood still for as long as anything remembers, and stiction holds the force that stays;
* vanished: without ticks, when the energy is 10⁻¹² of the first;
* beyond 10⁹ ticks;
* at the horizon, where the trend of the energy decides (`hapticd.stability.outcome`), but for two things that it cannot see:
  a damper lets the mass creep towards the edge of stiction for ever, which counts as rest; and where σ < ½ no tick has a
  force that friction holds, so that nothing that moves dies out.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numba import from_dtype, types
from numpy.typing import NDArray

from hapticd.jit import njit
from hapticd.plant.spring import propagate_with_stiffness
from hapticd.stability.map_kernel import LIMIT, energy
from hapticd.stability.maps import OUTCOMES, PERSISTENT
from hapticd.stability.outcome import RISE_TOLERANCE, STRETCHES, Outcome, decide
from hapticd.stability.passivity import dissipating_force, spring_potential

if TYPE_CHECKING:
    from hapticd.stability.damping import Damper
    from hapticd.stability.numbers import Dimensionless
    from hapticd.stability.storage import FloatArray

#: A loop and the start of its motion.
LOOP: Final = np.dtype(
    [
        ("mu", "f8"),
        ("beta", "f8"),
        ("sigma", "f8"),
        ("tau_d", "f8"),
        ("kappa", "f8"),
        ("beta_v", "f8"),  # virtual damping B/(KT)
        ("periods", "i8"),  # over which the damper takes its difference
        ("keep", "f8"),  # what a period leaves of its low-pass; 0 for the plain difference
        ("counts", "i8"),  # in a tick, as the passivity controller reads them; 0 for no controller
        ("stiffest", "f8"),  # its α T in units of K
        ("force_limit", "f8"),  # within which it adds, ticks of force
        ("ticks", "?"),  # whether the loop sees ticks, or the true position
        ("xi", "f8"),  # where the motion starts, ticks
        ("xi_dot", "f8"),  # and how fast, ticks per period
    ],
    align=True,
)

#: What became of it. ``amplitude`` (ticks, half of peak to peak at the samples) and ``omega`` (rad per period) are of the
#: last twelfth of the horizon, 0 at rest; ``outcome`` is an index into `OUTCOMES`.
RUN: Final = np.dtype(
    [
        ("outcome", "i8"),
        ("reason", "i8"),
        ("periods", "i8"),
        ("rose", "?"),
        ("xi", "f8"),
        ("xi_dot", "f8"),
        ("amplitude", "f8"),
        ("omega", "f8"),
        ("added", "f8"),  # largest force that the passivity controller added, ticks
        ("largest", "f8"),  # largest force asked for at all, ticks
        ("peaks", "f8", STRETCHES),
    ],
    align=True,
)

REST, VANISHED, LEFT, HORIZON = range(4)
_CHUNK = 100
_VANISHED = 1e-12
#: Ticks within which a motion that goes on is a creep.
_CREEP = 1e-9

#: Periods for which one motion is followed: tens of milliseconds at most.
HORIZON_PERIODS: Final = 50_000

_LOOPS = types.Array(from_dtype(LOOP), 1, "C")
_RUNS = types.Array(from_dtype(RUN), 1, "C")


@njit(inline=True)
def _stored(loop: Any, x: float, v: float) -> float:
    """Energy of a state in KΔ²; without ticks the spring's is ½ξ²."""
    own = energy(x, v, loop.mu) if loop.ticks else 0.5 * (loop.mu * v * v + x * x)
    return float(own + 0.5 * loop.kappa * x * x)


@njit(inline=True)
def _run(loop: Any, run: Any, periods: int, ring: Any, samples: Any) -> None:
    """Run one loop; ``ring`` holds the commands under way, ``samples`` the positions that the damper remembers."""
    mu, beta, sigma, kappa = loop.mu, loop.beta, loop.sigma, loop.kappa
    whole = math.floor(loop.tau_d)
    fraction = loop.tau_d - whole
    pending, window = whole + 1, loop.periods
    ring[:pending] = 0.0
    x, v = loop.xi, loop.xi_dot
    velocity = 0.0
    first = last = _stored(loop, x, v)
    half = periods // 2
    edge, stretch, peak = half, -1, 0.0
    still, reversals, heading = 0, 0, 0.0
    counts, counted, sent, excess = loop.counts, 0.0, 0.0, 0.0
    run.added = run.largest = 0.0
    low = high = x
    run.rose = False
    run.reason = HORIZON
    h = 0
    while h < periods:
        if not abs(x) <= LIMIT:
            run.reason = LEFT
            break
        if h == edge:
            if stretch >= 0:
                run.peaks[stretch] = peak
            peak = 0.0
            stretch += 1
            edge = half + (stretch + 1) * (periods - half) // STRETCHES
            low = high = x
            reversals = 0
        seen = math.floor(x) if loop.ticks else x
        spring = -seen - 0.5 if loop.ticks else -x
        past = samples[(h - min(h, window)) % window] if h > 0 else seen
        difference = (seen - past) / max(min(h, window), 1)
        velocity = loop.keep * velocity + (1.0 - loop.keep) * difference
        samples[h % window] = seen
        force = spring - loop.beta_v * velocity
        if counts > 0:
            middle = (math.floor(x * counts) + 0.5) / counts
            moved = middle - counted if h > 0 else 0.0
            work = sent * moved + spring_potential(middle, 0.5, 0.0) - spring_potential(counted, 0.5, 0.0)
            excess = max(0.0, excess + work) if h > 0 else 0.0
            counted = middle
            if moved != 0.0 and excess > 0.0:
                limit = max(loop.force_limit, abs(force))
                braked = force + dissipating_force(excess, moved, loop.stiffest)
                braked = max(-limit, min(limit, braked))
                run.added = max(run.added, abs(braked - force))
                force = braked
        run.largest = max(run.largest, abs(force))
        if still > pending + window and abs(spring - kappa * x) <= sigma and abs(force - kappa * x) <= sigma:
            run.reason = REST
            break
        if not loop.ticks and last <= _VANISHED * first:
            run.reason = VANISHED
            break
        before = ring[h % pending]
        ring[h % pending] = force
        sent = ring[(h + 1) % pending]  # what the amplifier has been told, by the end of this period
        start = x
        if fraction > 0.0:
            x, v = propagate_with_stiffness(x, v, fraction, before, mu, beta, sigma, kappa)
        x, v = propagate_with_stiffness(x, v, 1.0 - fraction, ring[(h + 1) % pending], mu, beta, sigma, kappa)
        still = still + 1 if v == 0.0 and x == start else 0
        now = _stored(loop, x, v)
        run.rose = run.rose or now > last * (1.0 + RISE_TOLERANCE)
        last = now
        peak = max(peak, now)
        low, high = min(low, x), max(high, x)
        if v != 0.0:
            reversals += int(heading * v < 0.0)
            heading = math.copysign(1.0, v)
        h += 1
    run.peaks[STRETCHES - 1] = peak
    run.periods, run.xi, run.xi_dot = h, x, v
    run.amplitude = run.omega = 0.0
    if run.reason == HORIZON:
        run.amplitude = 0.5 * (high - low)
        run.omega = math.pi * reversals * STRETCHES / (periods - half)
    elif run.reason == LEFT:
        run.amplitude = np.inf


@njit(types.void(_LOOPS, _RUNS, types.int64))
def _run_all(loops: Any, runs: Any, periods: int) -> None:
    longest, most = 1, 1
    for k in range(len(loops)):
        longest = max(longest, math.floor(loops[k].tau_d) + 1)
        most = max(most, loops[k].periods)
    ring, samples = np.zeros(longest), np.zeros(most)
    for k in range(len(loops)):
        _run(loops[k], runs[k], periods, ring, samples)


def run_loops(loops: NDArray[Any], periods: int) -> NDArray[Any]:
    """Run loops and classify what becomes of them.

    Args:
        loops: (n,) of `LOOP`. periods: the horizon, at least 12.

    Returns:
        (n,) of `RUN`.
    """
    runs = np.zeros(loops.size, RUN)
    _run_all(np.ascontiguousarray(loops), runs, periods)
    for run in runs:
        gone = run["reason"] in (REST, VANISHED)
        gone |= run["reason"] == HORIZON and run["amplitude"] < _CREEP
        outcome = decide(bool(run["rose"]), run["peaks"], at_rest=gone, grew_past_limit=run["reason"] == LEFT)
        run["outcome"] = OUTCOMES.index(outcome)
    restless = loops["ticks"] & (loops["sigma"] < 0.5) & (loops["kappa"] == 0.0) & (runs["reason"] == HORIZON)
    runs["outcome"][restless & (runs["outcome"] < PERSISTENT)] = PERSISTENT
    return runs


def run_in_threads(loops: NDArray[Any], periods: int, jobs: int | None = None) -> NDArray[Any]:
    """`run_loops` on threads, for any shape of loops.

    Args:
        loops: of `LOOP`. periods: the horizon, at least 12.
        jobs: threads; None for one per core that this process may use.
    """
    flat = loops.ravel()
    parts = [flat[k : k + _CHUNK] for k in range(0, flat.size, _CHUNK)]
    with ThreadPoolExecutor(jobs or len(os.sched_getaffinity(0)), thread_name_prefix="loops") as pool:
        return np.concatenate(list(pool.map(lambda part: run_loops(part, periods), parts))).reshape(loops.shape)


def loop_record(numbers: Dimensionless, damper: Damper, xi: FloatArray, xi_dot: FloatArray) -> NDArray[Any]:
    """One loop with n starts; (n,) of `LOOP`."""
    loops = np.zeros(np.broadcast(xi, xi_dot).size, LOOP)
    for name in ("mu", "beta", "sigma", "tau_d", "kappa"):
        loops[name] = getattr(numbers, name)
    for name in ("beta_v", "periods", "keep"):
        loops[name] = getattr(damper, name)
    loops["force_limit"] = np.inf
    loops["ticks"], loops["xi"], loops["xi_dot"] = True, xi, xi_dot
    return loops


@dataclass(frozen=True)
class ExactRun:
    """One motion of the exact loop.

    Attributes:
        xi: where it started, ticks. xi_dot: how fast, ticks per period.
        outcome: what became of it. periods: that were run.
        amplitude: of what is left, ticks. omega: its frequency, rad per period; both 0 at rest.
    """

    xi: float
    xi_dot: float
    outcome: Outcome
    periods: int
    amplitude: float
    omega: float

    @property
    def dies_out(self) -> bool:
        """Whether the motion ends."""
        return self.outcome in ("monotone", "decaying")


def exact_run(
    numbers: Dimensionless, damper: Damper, xi: float = 0.0, xi_dot: float = 0.0, *, linear: bool = False
) -> ExactRun:
    """Run one motion of a loop with ticks and friction, or of the ``linear`` one; ξ in ticks, ξ̇ in ticks per period."""
    loops = loop_record(numbers, damper, np.array([xi]), np.array([xi_dot]))
    if linear:
        loops["ticks"], loops["sigma"] = False, 0.0
    run = run_loops(loops, HORIZON_PERIODS)[0]
    ended = int(run["periods"]), float(run["amplitude"]), float(run["omega"])
    return ExactRun(xi, xi_dot, OUTCOMES[run["outcome"]], *ended)


def is_linearly_stable(numbers: Dimensionless, damper: Damper) -> bool:
    """Whether the loop without ticks and Coulomb friction dies out: then no motion of the whole loop grows for ever."""
    return exact_run(numbers, damper, xi_dot=1.0, linear=True).dies_out
