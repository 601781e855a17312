"""Exact simulation of the loop from sample to sample until the outcome is certain: for maps, exploration, Z-width.

One kernel, compiled twice. A *bare* loop is the spring of eq. 7–9, for the region maps. The other has everything that the
servo renders: virtual damping with its velocity estimate, a wall, no half tick, dither, a converter with steps and limits,
current saturation, the amplifier's second-order current loop (`hapticd.plant.lagged`), a hand's stiffness κ,
a spring without ticks (φ = −ξ), and the passivity controller (`hapticd.stability.passivity`), for which the whole delay is
T_V, because it needs the time of each command. Numbers are those of Table I. Period and friction are constant, so that the
exponentials of `hapticd.plant.exact` are computed once per run. A run ends

* at rest: the mass is at rest, and stiction holds every later force; in a bare loop also if it slides to rest within the
  present tick, because the force then cannot change (at σ = ½ the net force can be zero, and the slide takes infinitely
  long). Otherwise it must be at rest for the length of the loop's memory;
* vanished: without ticks, when the energy is 10⁻¹² of the initial one;
* beyond `far`, 10⁹ ticks or less;
* at the horizon, where the trend of the energy decides (`hapticd.stability.outcome`), with three exceptions: with a damper
  the mass may creep towards the edge of stiction without end, which counts as rest; if friction holds the force of no tick
  (`can_rest`; with ticks alone: σ < ½), no motion dies out; if the linear loop is stable, no motion grows.

A run that *searches* also ends

* recurred: the whole state of the loop equals that at an earlier sample (Brent's algorithm). One further cycle measures it.
  A region map compares bits; an exploration compares to nine digits of the amplitude, because a cycle hardly depends on its
  position within the tick, so that its rounding errors add up;
* escaped, if it is bare: growth is proven for its state (`hapticd.stability.escape`);
* settled: in three windows, each twice as long as the one before, the amplitude is the same (1 %, much less above one tick).
  In a region map the first window is as long as the horizon: there only a recurring motion has settled.

Energy is H_T (35), at the samples without delay and at h + τ_D with delay, from the arrival of the first command on.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numba import from_dtype, types
from numpy.typing import NDArray

from hapticd.jit import njit
from hapticd.plant.exact import phi_functions
from hapticd.plant.lagged import SPAN_WORDS, forgets, held_motion, lagged_motion, parts_per_time, prepare, stop_of
from hapticd.plant.noise import next_uniform
from hapticd.stability.escape import growth_proofs, never_grows
from hapticd.stability.outcome import (
    DECAYING,
    GROWING,
    MONOTONE,
    OUTCOMES,
    PERSISTENT,
    RISE_TOLERANCE,
    STRETCHES,
    decide,
)
from hapticd.stability.passivity import dissipating_force, spring_potential
from hapticd.stability.whole_loop import LOOP, RUN, UNIFORM, asked, delivered, read, stays, stored, wave

#: Why a run ended.
REST, RECURRED, ESCAPED, LEFT, HORIZON, VANISHED, SETTLED = range(7)
_VANISHED = 1e-12
#: Amplitude in ticks below which a motion is creep.
CREEP: Final = 1e-9
#: Tolerance of a recurring state: relative to the amplitude, and for the dither's phase, in turns.
_SAME: Final = 1e-9
#: A settled motion: relative difference of the windows, number of windows after the first, share of the friction's
#: work that may remain, and the amplitude in ticks from which a buzz is simulated to the horizon.
_SETTLED, _WINDOWS, _NET, _NEARLY = 0.01, 2, 0.03, 0.8
#: Most periods before a start for which the current loop of a start with memory is simulated.
_EARLIER: Final = 256
# Periods between two tests for a slide to rest and for proven growth; a power of two.
_LOOK = 64

_LOOPS = types.Array(from_dtype(LOOP), 1, "C")
_RUNS = types.Array(from_dtype(RUN), 1, "C")
_f8 = types.float64


@njit(inline=True)
def _resting_place(ring: Any, pending: int, x: float, v: float, mu: float, beta: float, sigma: float) -> float:
    """Position at which a bare loop is at rest, or will be if no force changes before; NaN if that is not certain."""
    tick = math.floor(x)
    force = -tick - 0.5
    if abs(force) > sigma:
        return np.nan
    for k in range(pending):
        if abs(ring[k]) > sigma or (v != 0.0 and ring[k] != force):
            return np.nan
    stop = stop_of(x, v, force, mu, beta, sigma) if v != 0.0 else x
    return stop if v == 0.0 or tick < stop < tick + 1.0 else np.nan


@njit(inline=True)
def _run(loop: Any, run: Any, periods: int, bare: bool, growth: Any, threshold: float, memory: Any, spans: Any) -> None:
    """Run one loop; ``bare`` is a literal in each call, so that the compiler removes what a bare loop does not have.

    ``growth`` is the eigenvector of `hapticd.stability.escape.Escape`, real and imaginary part, ``threshold`` its threshold,
    ``memory`` (4, …) work space: the pending commands, the positions in the damper's memory, and earlier copies of both;
    ``spans`` (2, SPAN_WORDS) that of the current loop.
    """
    ring, samples, ring_saved, samples_saved = memory[0], memory[1], memory[2], memory[3]
    mu, beta, sigma, far, ticks = loop.mu, loop.beta, loop.sigma, loop.far, bare or loop.ticks
    kappa, counts, window = (0.0, 0, 0) if bare else (loop.kappa, loop.counts, loop.periods)
    whole = math.floor(loop.tau_d)
    first_span = loop.tau_d - whole
    second_span = 1.0 - first_span
    e0, a0, b0 = phi_functions(-beta * first_span / mu)
    e1, a1, b1 = phi_functions(-beta * second_span / mu)
    pending = whole + 1
    x, v = loop.xi, loop.xi_dot
    ring[:pending] = 0.0
    velocity, known = 0.0, 0
    natural, current, rate = 0.0 if bare else loop.natural, 0.0, 0.0
    remembered = pending + window
    if natural > 0.0:
        remembered += forgets(natural, loop.ratio)
        finest = parts_per_time(natural, 1.0)
        prepare(natural, loop.ratio, mu, beta, finest, first_span, spans[0])
        prepare(natural, loop.ratio, mu, beta, finest, second_span, spans[1])
    if loop.known:
        velocity, known = loop.past, window
        for k in range(window):
            samples[(window - 1 - k) % window] = math.floor(x - loop.past * (k + 1))
        for k in range(pending):
            then = x - loop.past * (k + 1)
            ring[(pending - 1 - k) % pending] = delivered(loop, asked(loop, read(loop, then, 0.0), loop.past))
        for k in range(min(remembered - pending - window, _EARLIER), 0, -1):  # earlier commands of the current loop
            for part in range(2):
                then = x - loop.past * (k + pending - part)
                aim = delivered(loop, asked(loop, read(loop, then, 0.0), loop.past))
                arrival = lagged_motion(0.0, 0.0, current, rate, aim, mu, beta, np.inf, 0.0, spans[part])
                current, rate = arrival[2], arrival[3]
    half = periods // 2
    edge, stretch, peak = half, -1, 0.0
    first, last, rose = stored(ticks, mu, kappa, x, v), np.inf, False
    still, counted, excess, sent = 0, 0.0, 0.0, 0.0
    dithered = not bare and (loop.position_dither > 0.0 or loop.force_dither > 0.0)
    random, phase = loop.seed, loop.phase
    searching = loop.search > 0
    settles = searching and loop.search < periods
    # from `begun` on, to measure amplitude and frequency
    measuring, begun, low, high, reversals, heading = settles, 0, x, x, 0, v
    look, amplitude, equal = loop.search, np.inf, 0
    reference, next_reference, x_saved, v_saved = 0, 1, np.nan, np.nan
    back_low, back_high, pushed, lowest, highest = x, x, 0.0, x, x
    alike, weight = _SAME if settles else 0.0, math.sqrt(mu)
    velocity_saved, phase_saved, counted_saved, excess_saved = velocity, phase, counted, excess
    current_saved, rate_saved = current, rate
    run.reason, run.cycle, run.added, run.largest = HORIZON, 0, 0.0, 0.0
    slot = sample_slot = 0
    h, end = 0, periods
    while h < end:
        if not abs(x) <= far:
            run.reason = LEFT
            break
        if h == edge:
            if stretch >= 0:
                run.peaks[stretch] = peak
            peak = 0.0
            stretch += 1
            edge = half + (stretch + 1) * (periods - half) // STRETCHES
            if stretch == STRETCHES - 1 and not settles:
                measuring, begun, low, high, pushed = True, h, x, x, 0.0
        if settles and h == look:
            before_it, amplitude = amplitude, 0.5 * (high - low)
            # above a tick, compared with the dissipation by friction alone
            near = _SETTLED * amplitude
            if amplitude >= 1.0:
                near = min(near, max(1e-6 * amplitude, _NET * (h - begun) * sigma / math.sqrt(mu)))
            equal = equal + 1 if abs(amplitude - before_it) <= near + CREEP else 0
            if equal >= _WINDOWS and not _NEARLY < amplitude < 1.0:
                run.reason = SETTLED
                break
            look = h + 2 * (h - begun)
            begun, low, high, reversals, pushed = h, x, x, 0, 0.0
        if searching:
            near = alike * (back_high - back_low)
            if abs(x - x_saved) <= near and weight * abs(v - v_saved) <= near and abs(phase - phase_saved) <= alike:
                same = counted == counted_saved and abs(excess - excess_saved) <= near
                same = same and abs(velocity - velocity_saved) <= near
                same = same and abs(current - current_saved) <= near and abs(rate - rate_saved) <= near
                same = same and not (dithered and loop.waveform == UNIFORM)
                for k in range(pending):
                    same = same and abs(ring[(slot + k) % pending] - ring_saved[k]) <= near
                for k in range(window if loop.beta_v > 0.0 else 0):
                    same = same and samples[(sample_slot + k) % window] == samples_saved[k]
                if same:
                    run.reason, run.cycle = RECURRED, h - reference
                    searching = settles = False
                    edge, end = -1, h + run.cycle
                    measuring, begun, low, high, reversals, pushed = True, h, x, x, 0, 0.0
            if h == next_reference:
                reference, next_reference = h, h + max(1, h // 4) if settles else 2 * h
                back_low = back_high = x
                x_saved, v_saved, velocity_saved, phase_saved = x, v, velocity, phase
                counted_saved, excess_saved, current_saved, rate_saved = counted, excess, current, rate
                for k in range(pending):
                    ring_saved[k] = ring[(slot + k) % pending]
                for k in range(window):
                    samples_saved[k] = samples[(sample_slot + k) % window]
        if bare:
            looks = searching and h & (_LOOK - 1) == 0
            if v == 0.0 or looks:
                stop = _resting_place(ring, pending, x, v, mu, beta, sigma)
                if stop == stop:
                    run.reason, x, v = REST, stop, 0.0
                    break
            if looks and threshold < np.inf:
                real = growth[0, 0] * x + growth[0, 1] * v
                imaginary = growth[1, 0] * x + growth[1, 1] * v
                for k in range(pending):
                    real += growth[0, 2 + k] * ring[(slot + k) % pending]
                    imaginary += growth[1, 2 + k] * ring[(slot + k) % pending]
                if real * real + imaginary * imaginary > threshold * threshold:
                    run.reason = ESCAPED
                    break
            force = -math.floor(x) - 0.5
        else:
            dither = 0.0
            if dithered and loop.waveform == UNIFORM:
                random, dither = next_uniform(random)
            elif dithered:
                dither = wave(loop.waveform, phase)
                phase += loop.turns
                phase -= math.floor(phase)
            seen = float(math.floor(x)) if ticks else x
            past = samples[(sample_slot + window - known) % window] if known > 0 else seen
            velocity = loop.keep * velocity + (1.0 - loop.keep) * ((seen - past) / max(known, 1))
            samples[sample_slot] = seen
            sample_slot = sample_slot + 1 if sample_slot + 1 < window else 0
            known = min(known + 1, window)
            force = asked(loop, read(loop, x, dither), velocity) + loop.force_dither * dither
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
            force = delivered(loop, force)
            if still > remembered and stays(loop, x, force):
                run.reason = REST
                break
            if not ticks and last <= _VANISHED * first:
                run.reason = VANISHED
                break
        pushed += force
        before = ring[slot]
        ring[slot] = force
        slot = slot + 1 if slot + 1 < pending else 0
        sent = ring[slot]  # the last command to the amplifier, at the end of this period
        start = x
        for part in range(2):
            held = sent if part else before
            x_before, v_before = x, v
            if natural > 0.0:
                arrival = lagged_motion(x, v, current, rate, held, mu, beta, sigma, kappa, spans[part])
                x, v, current, rate, lowest, highest = arrival
            elif part:
                x, v = held_motion(x, v, second_span, held, mu, beta, sigma, kappa, e1, a1, b1)
            elif first_span > 0.0:
                x, v = held_motion(x, v, first_span, held, mu, beta, sigma, kappa, e0, a0, b0)
            if part == 0 and h >= whole:
                now = stored(ticks, mu, kappa, x, v)
                rose = rose or now > last * (1.0 + RISE_TOLERANCE)
                last = now
                peak = max(peak, now)
            if measuring and (part or first_span > 0.0):
                if natural > 0.0:
                    low, high = min(low, lowest), max(high, highest)
                elif v * v_before < 0.0 and kappa == 0.0:
                    turn = stop_of(x_before, v_before, held, mu, beta, sigma)
                    low, high = min(low, turn), max(high, turn)
                low, high = min(low, x), max(high, x)
                reversals += int(heading * v < 0.0)
            heading = v if v != 0.0 else heading  # the last velocity other than 0
        still = still + 1 if v == 0.0 and x == start else 0
        back_low, back_high = min(back_low, x), max(back_high, x)
        h += 1
    run.peaks[STRETCHES - 1] = peak
    if bare and run.reason == HORIZON:
        stop = _resting_place(ring, pending, x, v, mu, beta, sigma)
        if stop == stop:
            run.reason, x, v = REST, stop, 0.0
    run.periods, run.xi, run.xi_dot, run.rose = h - run.cycle, x, v, rose
    run.amplitude = run.omega = 0.0
    run.centre, run.lean = 0.5 * (low + high), pushed / max(h - begun, 1)
    if run.reason == LEFT or run.reason == ESCAPED:
        run.amplitude = np.inf
    elif run.reason == HORIZON or run.reason == SETTLED or run.reason == RECURRED:
        run.amplitude = 0.5 * (high - low)
        if settles and amplitude < np.inf and 8 * (h - begun) < h:  # the window alone is too short
            run.amplitude = max(run.amplitude, amplitude)
        run.omega = math.pi * reversals / max(h - begun, 1)


@njit(types.void(_LOOPS, _RUNS, types.int64, types.int64[::1], _f8[:, :, ::1], _f8[::1]))
def _run_all(loops: Any, runs: Any, periods: int, bare: Any, growth: Any, thresholds: Any) -> None:
    """Run loops; ``bare`` is the index of each into ``growth``, −1 for one that is not bare."""
    longest = 1
    for k in range(len(loops)):
        longest = max(longest, math.floor(loops[k].tau_d) + 1, loops[k].periods)
    memory, spans = np.zeros((4, longest)), np.zeros((2, SPAN_WORDS))
    for k in range(len(loops)):
        if bare[k] >= 0:
            _run(loops[k], runs[k], periods, True, growth[bare[k]], thresholds[k], memory, spans)
        else:
            _run(loops[k], runs[k], periods, False, growth[0], thresholds[k], memory, spans)


@njit(types.boolean(_LOOPS))
def _held_somewhere(loops: Any) -> bool:
    held = False
    for k in range(-48, 49):
        held = held or stays(loops[0], k / 24.0, 0.0)
    return held


def can_rest(loop: Any) -> bool:
    """Whether Coulomb friction holds, at some position, every force that the loop may command; `loop` is of `LOOP`."""
    return bool(not loop["ticks"] or loop["kappa"] > 0.0 or _held_somewhere(np.array([loop], LOOP)))


def run_loops(loops: NDArray[Any], periods: int) -> NDArray[Any]:
    """Run loops and classify their outcomes.

    Args:
        loops: (n,) of `LOOP`. periods: the horizon, at least 12.

    Returns:
        (n,) of `RUN`.
    """
    runs = np.zeros(loops.size, RUN)
    bare, growth, thresholds = growth_proofs(loops)
    _run_all(np.ascontiguousarray(loops), runs, periods, bare, growth, thresholds)
    reason = runs["reason"]
    calm = np.where(runs["rose"], DECAYING, MONOTONE)
    at_rest, grew = (reason == REST) | (reason == VANISHED), (reason == LEFT) | (reason == ESCAPED)
    runs["outcome"] = np.select([at_rest, grew], [calm, GROWING], PERSISTENT)
    settles = (loops["search"] > 0) & (loops["search"] < periods)
    undecided = np.flatnonzero(reason == HORIZON)
    for k, bound in zip(undecided, never_grows(loops[undecided]), strict=True):
        run = runs[k]
        creeps = bool(run["amplitude"] < CREEP)
        outcome = OUTCOMES.index(decide(bool(run["rose"]), run["peaks"], at_rest=creeps, grew_past_limit=False))
        bounded = bound or (bare[k] >= 0 and thresholds[k] == np.inf)
        # a search whose windows differ may still converge to a buzz
        restless = outcome in (MONOTONE, DECAYING) and not settles[k] and not can_rest(loops[k])
        run["outcome"] = PERSISTENT if restless or (outcome == GROWING and bounded) else outcome
    return runs
