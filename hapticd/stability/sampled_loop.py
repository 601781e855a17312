"""The loop with all that the servo renders, exactly, from sample to sample: where no theorem covers it, this runs it.

Beyond `hapticd.stability.map_kernel`, which is the bare spring of eq. 7–9: virtual damping with its velocity estimate, a
wall, no half tick, dither, a converter that rounds and ends, a current that saturates, a hand's stiffness κ, a spring
without ticks (φ = −ξ), and the passivity controller (`hapticd.stability.passivity`), for which the whole delay is T_V: it
knows when a command is sent. The amplifier is the delay of (5), as in ``hapticd simulate``. Numbers are those of Table I.
A run ends

* at rest: the mass has stood still for as long as anything remembers, and stiction holds whatever force may come;
* vanished: without ticks, when the energy is 10⁻¹² of the first;
* beyond `far`, 10⁹ ticks or less;
* at the horizon, where the trend of the energy decides (`hapticd.stability.outcome`), but for two things that it cannot see:
  a damper lets the mass creep towards the edge of stiction for ever, which counts as rest; and where no tick has a force
  that friction holds (`can_rest`; σ < ½ with ticks alone), nothing that moves dies out.

A run that *searches* (`hapticd.stability.explore`) also ends

* recurred: everything that the loop remembers is bit for bit that of an earlier sample (Brent's search);
* settled: in three windows, each twice as long as the one before, it goes equally far (1 %, much less above one tick).
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final

import numpy as np
from numba import from_dtype, types
from numpy.typing import NDArray

from hapticd.jit import njit
from hapticd.plant.exact import phi_functions, step
from hapticd.plant.noise import next_uniform
from hapticd.plant.spring import propagate_with_stiffness
from hapticd.stability.map_kernel import energy, turning_point
from hapticd.stability.maps import OUTCOMES, PERSISTENT
from hapticd.stability.outcome import RISE_TOLERANCE, STRETCHES, decide
from hapticd.stability.passivity import dissipating_force, spring_potential
from hapticd.stability.whole_loop import LOOP, RUN, UNIFORM

REST, VANISHED, LEFT, HORIZON, RECURRED, SETTLED = range(6)
#: What a search that ends so has become.
_ENDED = np.array([OUTCOMES.index(name) for name in ("decaying", "decaying", "growing", *3 * ("persistent",))])
_CHUNK = 100
_VANISHED = 1e-12
#: Ticks within which a motion that goes on is a creep.
CREEP: Final = 1e-9
#: How equal the windows of a search are when a motion counts as settled, how many after the first, the share of friction's
#: work that may be left over, and the amplitude in ticks from which a buzz is followed to the horizon.
_SETTLED, _WINDOWS, _NET, _NEARLY = 0.01, 2, 0.03, 0.8

_LOOPS = types.Array(from_dtype(LOOP), 1, "C")
_RUNS = types.Array(from_dtype(RUN), 1, "C")


@njit(inline=True)
def _stored(loop: Any, x: float, v: float) -> float:
    """Energy of a state in KΔ²; without ticks the spring's is ½ξ²."""
    own = energy(x, v, loop.mu) if loop.ticks else 0.5 * (loop.mu * v * v + x * x)
    return float(own + 0.5 * loop.kappa * x * x)


@njit(inline=True)
def _wave(waveform: int, phase: float) -> float:
    """Sine, triangle or square of unit peak at ``phase`` turns, 0 ≤ phase < 1, rising from 0 (square: +1 first)."""
    if waveform == 1:
        return math.sin(2.0 * math.pi * phase)
    if waveform == 2:
        quarter = phase + 0.25
        return 1.0 - 4.0 * abs(quarter - math.floor(quarter) - 0.5)
    return 1.0 if phase < 0.5 else -1.0


@njit(inline=True)
def _read(loop: Any, x: float, dither: float) -> float:
    """What the spring reads: the tick, with position dither that of the count and the dither."""
    if loop.position_dither > 0.0:
        return float(math.floor(math.floor(x * loop.grain) / loop.grain + loop.position_dither * dither))
    return float(math.floor(x)) if loop.ticks else x


@njit(inline=True)
def _asked(loop: Any, read: float, velocity: float) -> float:
    """Force of spring and damper for what they read, in ticks; a wall does not pull."""
    force = -(read + loop.bias) - loop.beta_v * velocity if loop.ticks else -read - loop.beta_v * velocity
    if (loop.side > 0.0 and (read < 0.0 or force > 0.0)) or (loop.side < 0.0 and (read >= 0.0 or force < 0.0)):
        return 0.0
    return float(force)


@njit(inline=True)
def _delivered(loop: Any, force: float) -> float:
    """What amplifier and converter make of a force, in ticks."""
    force = max(-loop.clip, min(loop.clip, force))
    if loop.step > 0.0:
        force = loop.step * max(-loop.codes - 1.0, min(loop.codes, np.rint(force / loop.step)))
        force = max(-loop.clip, min(loop.clip, force))
    return float(force)


@njit(inline=True)
def _stays(loop: Any, x: float, force: float) -> bool:
    """Whether stiction holds a mass that stands at x, under this force and under any that dither can make of it."""
    low = _delivered(loop, _asked(loop, _read(loop, x, 1.0), 0.0) - loop.force_dither)
    high = _delivered(loop, _asked(loop, _read(loop, x, -1.0), 0.0) + loop.force_dither)
    pull, sigma = loop.kappa * x, loop.sigma
    return bool(abs(low - pull) <= sigma and abs(high - pull) <= sigma and abs(force - pull) <= sigma)


@njit(inline=True)
def _run(loop: Any, run: Any, periods: int, ring: Any, samples: Any, saved: Any, saved_samples: Any) -> None:
    """Run one loop; ``ring`` holds the commands under way, ``samples`` the positions that the damper remembers."""
    mu, beta, sigma, kappa = loop.mu, loop.beta, loop.sigma, loop.kappa
    whole = math.floor(loop.tau_d)
    fraction = loop.tau_d - whole
    e0, a0, b0 = phi_functions(-beta * fraction / mu)
    e1, a1, b1 = phi_functions(-beta * (1.0 - fraction) / mu)
    pending, window = whole + 1, loop.periods
    x, v = loop.xi, loop.xi_dot
    ring[:pending] = 0.0
    velocity, counted_samples = 0.0, 0
    if loop.known:
        velocity, counted_samples = loop.past, window
        for k in range(window):
            samples[(window - 1 - k) % window] = math.floor(x - loop.past * (k + 1))
        for k in range(pending):
            then = x - loop.past * (k + 1)
            ring[(pending - 1 - k) % pending] = _delivered(loop, _asked(loop, _read(loop, then, 0.0), loop.past))
    first = last = _stored(loop, x, v)
    half = periods // 2
    edge, stretch, peak = half, -1, 0.0
    still, reversals, heading = 0, 0, 0.0
    counts, counted, sent, excess = loop.counts, 0.0, 0.0, 0.0
    run.added = run.largest = 0.0
    low = high = recurring_low = recurring_high = x
    run.rose = False
    run.reason = HORIZON
    dithered = loop.position_dither > 0.0 or loop.force_dither > 0.0
    random, phase = loop.seed, loop.phase
    searching, begun, end = loop.search > 0, 0, loop.search
    amplitude, equal = np.inf, 0
    next_reference, reference, recurring_reversals = 1, 0, 0
    x_saved, v_saved, velocity_saved, phase_saved = np.nan, np.nan, np.nan, np.nan
    slot = sample_slot = 0
    h = 0
    while h < periods:
        if not abs(x) <= loop.far:
            run.reason = LEFT
            break
        if h == edge:
            if stretch >= 0:
                run.peaks[stretch] = peak
            peak = 0.0
            stretch += 1
            edge = half + (stretch + 1) * (periods - half) // STRETCHES
            if not searching:
                low = high = x
                begun, reversals = h, 0
        if searching:
            if h == end:
                before_it, amplitude = amplitude, 0.5 * (high - low)
                # above a tick, beside what friction alone would have taken away meanwhile
                near = _SETTLED * amplitude
                if amplitude >= 1.0:
                    near = min(near, max(1e-6 * amplitude, _NET * (h - begun) * sigma / math.sqrt(mu)))
                equal = equal + 1 if abs(amplitude - before_it) <= near + CREEP else 0
                if equal >= _WINDOWS and not _NEARLY < amplitude < 1.0:
                    run.reason = SETTLED
                    break
                end = h + 2 * (h - begun)
                low = high = x
                begun, reversals = h, 0
            if x == x_saved and v == v_saved and velocity == velocity_saved and phase == phase_saved:
                same = not (dithered and loop.waveform == UNIFORM)
                for k in range(pending):
                    same = same and ring[(slot + k) % pending] == saved[k]
                for k in range(window if loop.beta_v > 0.0 else 0):
                    same = same and samples[(sample_slot + k) % window] == saved_samples[k]
                if same:
                    run.reason = RECURRED
                    break
            if h == next_reference:
                next_reference = 2 * h
                x_saved, v_saved, velocity_saved, phase_saved = x, v, velocity, phase
                for k in range(pending):
                    saved[k] = ring[(slot + k) % pending]
                for k in range(window):
                    saved_samples[k] = samples[(sample_slot + k) % window]
                # from here on, so that a recurrence knows how far its cycle goes
                recurring_low = recurring_high = x
                reference, recurring_reversals = h, 0
        dither = 0.0
        if dithered:
            if loop.waveform == UNIFORM:
                random, dither = next_uniform(random)
            else:
                dither = _wave(loop.waveform, phase)
                phase += loop.turns
                phase -= math.floor(phase)
        seen = float(math.floor(x)) if loop.ticks else x
        known = min(counted_samples, window)
        past = samples[(sample_slot + window - known) % window] if known > 0 else seen
        velocity = loop.keep * velocity + (1.0 - loop.keep) * ((seen - past) / max(known, 1))
        samples[sample_slot] = seen
        sample_slot = sample_slot + 1 if sample_slot + 1 < window else 0
        counted_samples += 1
        force = _asked(loop, _read(loop, x, dither), velocity) + loop.force_dither * dither
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
        force = _delivered(loop, force)
        if still > pending + window and _stays(loop, x, force):
            run.reason = REST
            break
        if not loop.ticks and last <= _VANISHED * first:
            run.reason = VANISHED
            break
        before = ring[slot]
        ring[slot] = force
        slot = slot + 1 if slot + 1 < pending else 0
        sent = ring[slot]  # what the amplifier has been told, by the end of this period
        start = x
        for part in range(2):
            held = sent if part else before
            x_before, v_before = x, v
            if kappa > 0.0:
                span = 1.0 - fraction if part else fraction
                x, v = propagate_with_stiffness(x, v, span, held, mu, beta, sigma, kappa)
            elif part:
                x, v = step(x, v, 1.0 - fraction, held, mu, beta, sigma, e1, a1, b1)
            elif fraction > 0.0:
                x, v = step(x, v, fraction, held, mu, beta, sigma, e0, a0, b0)
            if searching and kappa == 0.0 and v * v_before < 0.0:
                turn = turning_point(x_before, v_before, held, mu, beta, sigma)
                low, high = min(low, turn), max(high, turn)
                recurring_low, recurring_high = min(recurring_low, turn), max(recurring_high, turn)
        still = still + 1 if v == 0.0 and x == start else 0
        now = _stored(loop, x, v)
        run.rose = run.rose or now > last * (1.0 + RISE_TOLERANCE)
        last = now
        peak = max(peak, now)
        low, high = min(low, x), max(high, x)
        recurring_low, recurring_high = min(recurring_low, x), max(recurring_high, x)
        if v != 0.0:
            turned = int(heading * v < 0.0)
            reversals += turned
            recurring_reversals += turned
            heading = math.copysign(1.0, v)
        h += 1
    run.peaks[STRETCHES - 1] = peak
    run.periods, run.xi, run.xi_dot = h, x, v
    run.amplitude = run.omega = 0.0
    if run.reason == HORIZON or run.reason == SETTLED:
        run.amplitude = 0.5 * (high - low)
        if searching and amplitude < np.inf and 8 * (h - begun) < h:  # too short a window to tell alone
            run.amplitude = max(run.amplitude, amplitude)
        run.omega = math.pi * reversals / max(h - begun, 1)
    elif run.reason == RECURRED:
        run.amplitude = 0.5 * (recurring_high - recurring_low)
        run.omega = math.pi * recurring_reversals / max(h - reference, 1)
    elif run.reason == LEFT:
        run.amplitude = np.inf


@njit(types.void(_LOOPS, _RUNS, types.int64))
def _run_all(loops: Any, runs: Any, periods: int) -> None:
    longest, most = 1, 1
    for k in range(len(loops)):
        longest = max(longest, math.floor(loops[k].tau_d) + 1)
        most = max(most, loops[k].periods)
    ring, samples, saved, saved_samples = np.zeros(longest), np.zeros(most), np.zeros(longest), np.zeros(most)
    for k in range(len(loops)):
        _run(loops[k], runs[k], periods, ring, samples, saved, saved_samples)


@njit(types.boolean(_LOOPS))
def _held_somewhere(loops: Any) -> bool:
    held = False
    for k in range(-48, 49):
        held = held or _stays(loops[0], k / 24.0, 0.0)
    return held


def can_rest(loop: Any) -> bool:
    """Whether there is a place where Coulomb friction holds whatever force the loop may command; `loop` is of `LOOP`."""
    return bool(not loop["ticks"] or loop["kappa"] > 0.0 or _held_somewhere(np.array([loop], LOOP)))


def run_loops(loops: NDArray[Any], periods: int) -> NDArray[Any]:
    """Run loops and classify what becomes of them.

    Args:
        loops: (n,) of `LOOP`. periods: the horizon, at least 12.

    Returns:
        (n,) of `RUN`.
    """
    runs = np.zeros(loops.size, RUN)
    _run_all(np.ascontiguousarray(loops), runs, periods)
    runs["outcome"] = _ENDED[runs["reason"]]
    for k in np.flatnonzero((loops["search"] == 0) | (runs["reason"] == HORIZON)):  # energies tell a search no more
        run = runs[k]
        gone = run["reason"] in (REST, VANISHED)
        gone |= run["reason"] == HORIZON and run["amplitude"] < CREEP
        outcome = decide(bool(run["rose"]), run["peaks"], at_rest=gone, grew_past_limit=run["reason"] == LEFT)
        run["outcome"] = OUTCOMES.index(outcome)
    going = (runs["reason"] == HORIZON) & (loops["search"] == 0) & (runs["outcome"] < PERSISTENT)
    restless = going.copy()
    restless[going] = [not can_rest(loop) for loop in loops[going]]
    runs["outcome"][restless] = PERSISTENT
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
