"""A second simulator of the rendered spring, for judging the first: in SI units, from eq. 1–2 and the config's keys alone.

It shares no code with the product. Between two changes of the motor's current the motion of a mass with viscous and Coulomb
friction is a closed form, from stop to stop; nothing is stepped. Knows virtual damping with each velocity estimate, the
converter, dither of every waveform, any delay, walls, no half tick, and the amplifier's current loop of second order, whose
current is divided finely and is constant in each part; not a hand's stiffness, nor effects of the plant.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Floats = NDArray[np.float64]

RESTS, BUZZES, MOVES_ON, UNDECIDED = range(4)
_MEMORY: Final = 1024
_FAR: Final = 1e7
_LONGER: Final = 16

(
    MASS, VISCOUS, COULOMB, STIFFNESS, DAMPING, COUNT, DECIMATION, PERIOD, DELAY, BIAS, SIDE, WINDOW, KEEP, AMPERE, CODE,
    CODES, PEAK, TARGET, WAVE, AMPLITUDE, TURNS, FADES, EARLY,
) = range(23)  # fmt: skip
#: Parts of each part of a period in which the current is constant. For either: what moves current and slope on; its mean.
_PARTS: Final = 40
LATE: Final = EARLY + 6
SIZE: Final = LATE + 6


def numbers_of(config: Any) -> Floats:
    """The keys of a config that matter, as one vector."""
    p = np.zeros(SIZE)
    encoder, spring, amplifier, dither = config.encoder, config.spring, config.amplifier, config.dither
    p[MASS], p[VISCOUS], p[COULOMB] = config.plant.inertia, config.plant.viscous, config.plant.coulomb
    p[STIFFNESS], p[DAMPING] = spring.stiffness, spring.damping
    p[COUNT] = 2.0 * math.pi / encoder.counts_per_rev
    p[DECIMATION] = encoder.decimation
    p[PERIOD], p[DELAY] = 1.0 / config.servo.rate_hz, config.delay.computation_s
    p[BIAS] = 0.5 * spring.half_tick_bias
    p[SIDE] = {"both": 0, "positive": 1, "negative": -1}[spring.side]
    p[WINDOW] = 1
    if spring.velocity_estimate == "difference":
        p[WINDOW] = spring.velocity_periods
    else:
        p[KEEP] = math.exp(-2.0 * math.pi * spring.velocity_cutoff_hz * p[PERIOD])
    p[AMPERE] = amplifier.torque_constant
    if amplifier.dac_bits:
        p[CODE] = amplifier.dac_full_scale / 2 ** (amplifier.dac_bits - 1)
        p[CODES] = 2 ** (amplifier.dac_bits - 1)
    p[PEAK] = amplifier.peak_current or np.inf
    p[TARGET] = {"none": 0, "position": 1, "current": 2}[dither.target]
    p[WAVE] = {"sine": 0, "triangle": 1, "square": 2, "uniform": 3}[dither.waveform]
    p[AMPLITUDE], p[TURNS] = dither.amplitude, dither.frequency_hz * p[PERIOD]
    if amplifier.bandwidth_hz:
        turn, ratio = 2.0 * math.pi * amplifier.bandwidth_hz, amplifier.damping_ratio
        late = p[DELAY] / p[PERIOD] % 1.0
        flow = np.array([[0.0, turn, 0.0], [-turn, -2.0 * ratio * turn, 0.0], [1.0, 0.0, 0.0]])
        for first, share in ((EARLY, late), (LATE, 1.0 - late)):
            time = max(share, 1e-9) * p[PERIOD] / _PARTS
            moved = expm(flow * time)
            p[first : first + 6] = [*moved[0, :2], *moved[1, :2], *(moved[2, :2] / time)]
        slowest = -np.linalg.eigvals(flow[:2, :2]).real.max()
        p[FADES] = math.ceil(16.0 / (slowest * p[PERIOD]))
    return p


@numba.njit(nogil=True, cache=True)
def _current(p: Any, tick: float, velocity: float, extra: float) -> float:
    force = -p[STIFFNESS] * p[COUNT] * p[DECIMATION] * (tick + p[BIAS]) - p[DAMPING] * velocity
    if p[SIDE] > 0 and (tick < 0 or force > 0):
        force = 0.0
    if p[SIDE] < 0 and (tick >= 0 or force < 0):
        force = 0.0
    current = min(p[PEAK], max(-p[PEAK], force / p[AMPERE] + extra))
    if p[CODE] > 0:
        current = min(p[CODES] - 1, max(-p[CODES], np.round(current / p[CODE]))) * p[CODE]
    return current


@numba.njit(nogil=True, cache=True)
def _move(p: Any, x: float, v: float, force: float, time: float, ends: Any) -> tuple[float, float]:
    """Through a time of constant force; ``ends`` takes in where it turns."""
    m, b, c = p[MASS], p[VISCOUS], p[COULOMB]
    rate = b / m
    while time > 0.0:
        if v == 0.0:
            if abs(force) <= c:
                break
            way = 1.0 if force > 0 else -1.0
        else:
            way = 1.0 if v > 0 else -1.0
        push = (force - way * c) / m
        if rate * time > 1e-7:
            last = push / rate
            after = last + (v - last) * math.exp(-rate * time)
            turn = math.log1p(-v / last) / rate if way * after < 0 else time
            x += last * turn - (v - last) * math.expm1(-rate * turn) / rate
        else:
            after = v + push * time
            turn = -v / push if way * after < 0 else time
            x += v * turn + 0.5 * push * turn * turn
        v = 0.0 if way * after < 0 else after
        if v == 0.0:
            ends[0], ends[1] = min(ends[0], x), max(ends[1], x)
        time -= turn
    return x, v


@numba.njit(nogil=True, cache=True)
def _through(
    p: Any, x: float, v: float, sent: float, time: float, made: int, loop: Any, ends: Any
) -> tuple[float, float]:
    """The same under a command [A] that has just reached the current loop; ``loop`` is its current and slope."""
    if p[FADES] == 0:
        return _move(p, x, v, sent * p[AMPERE], time, ends)
    for _ in range(_PARTS):
        off, slope = loop[0] - sent, loop[1]
        mean = sent + p[made + 4] * off + p[made + 5] * slope
        loop[0], loop[1] = sent + p[made] * off + p[made + 1] * slope, p[made + 2] * off + p[made + 3] * slope
        x, v = _move(p, x, v, mean * p[AMPERE], time / _PARTS, ends)
    return x, v


@numba.njit(nogil=True, cache=True)
def _tick(p: Any, x: float, dither: float) -> float:
    raw = math.floor(x / p[COUNT])
    if p[TARGET] == 1:
        return math.floor(raw / p[DECIMATION] + dither)
    return math.floor(raw / p[DECIMATION])


@numba.njit(nogil=True, cache=True)
def _run(p: Any, start: Any, horizon: int, out: Any) -> None:
    period, delta = p[PERIOD], p[COUNT] * p[DECIMATION]
    x, v = start[0] * delta, start[1] * delta / period
    late = p[DELAY] / period
    whole = math.floor(late)
    part = late - whole
    window = int(p[WINDOW])
    sent, seen = np.zeros(_MEMORY), np.zeros(_MEMORY)
    estimate, phase, first = 0.0, start[3], True
    remembered = 0
    if start[2] > 0.0:  # the shaft came at this speed
        for k in range(_MEMORY):
            before = x - (k + 1) * v * period
            seen[-1 - k] = math.floor(math.floor(before / p[COUNT]) / p[DECIMATION])
            sent[-1 - k] = _current(p, _tick(p, before, 0.0), v, 0.0)
        estimate, first, remembered = v, False, _MEMORY
    loop, still = np.zeros(2), np.zeros(2)
    if p[FADES] > 0 and remembered > 0:  # what has reached it before
        for k in range(_MEMORY - whole - 2, 0, -1):
            if part > 0:
                _through(p, 0.0, 0.0, sent[-1 - k - whole], 0.0, EARLY, loop, still)
            _through(p, 0.0, 0.0, sent[-k - whole], 0.0, LATE, loop, still)
    ends = np.array([x, x])
    stood, check, before_it, heading, turns = 0, horizon // 8, np.inf, 0.0, 0
    chance = int(1e6 * start[3]) + 1
    out[1] = 0.0
    # Brent's search for a state that comes again, bit for bit; then the cycle is followed once more for its size
    mark, marked, place_marked, speed_marked, estimate_marked, phase_marked = 1, 0, np.nan, np.nan, np.nan, np.nan
    sent_marked, seen_marked, closing = np.zeros(whole + 1), np.zeros(window), 0
    loop_marked = loop.copy()
    for h in range(_LONGER * horizon):
        if h == closing > 0:
            size = 0.5 * (ends[1] - ends[0]) / delta
            out[0], out[1] = BUZZES if size < 1.0 else MOVES_ON, size
            return
        if closing == 0 and x == place_marked and v == speed_marked and phase == phase_marked:
            same = estimate == estimate_marked and (p[TARGET] == 0 or p[WAVE] != 3)
            same = same and loop[0] == loop_marked[0] and loop[1] == loop_marked[1]
            for k in range(whole + 1):
                same = same and sent[(h - 1 - k) % _MEMORY] == sent_marked[k]
            for k in range(window):
                same = same and seen[(h - 1 - k) % _MEMORY] == seen_marked[k]
            if same and v != 0.0:
                closing = 2 * h - marked
                ends[0] = ends[1] = x
        if h == mark and closing == 0:
            mark, marked = 2 * h, h
            place_marked, speed_marked, estimate_marked, phase_marked = x, v, estimate, phase
            loop_marked[:] = loop
            for k in range(whole + 1):
                sent_marked[k] = sent[(h - 1 - k) % _MEMORY]
            for k in range(window):
                seen_marked[k] = seen[(h - 1 - k) % _MEMORY]
        tick = math.floor(math.floor(x / p[COUNT]) / p[DECIMATION])
        back = min(window, h + remembered)
        if not first:
            estimate = p[KEEP] * estimate + (1 - p[KEEP]) * (tick - seen[(h - back) % _MEMORY]) * delta / (
                back * period
            )
        first = False
        seen[h % _MEMORY] = tick
        wave = 0.0
        if p[TARGET] > 0:
            if p[WAVE] == 3:
                chance = (1103515245 * chance + 12345) % 2147483648
                wave = 2 * chance / 2147483648 - 1
            elif p[WAVE] == 2:
                wave = 1.0 if phase < 0.5 else -1.0
            elif p[WAVE] == 1:
                wave = 4 * phase if phase < 0.25 else (2 - 4 * phase if phase < 0.75 else 4 * phase - 4)
            else:
                wave = math.sin(2 * math.pi * phase)
            phase = (phase + p[TURNS]) % 1.0
        wave *= p[AMPLITUDE]
        sent[h % _MEMORY] = _current(p, _tick(p, x, wave), estimate, wave if p[TARGET] == 2 else 0.0)
        # what a dither sets swinging in a current loop is seen in the windows alone
        if v == 0.0 and stood > window + whole + 3 + p[FADES] and (p[FADES] == 0 or p[TARGET] == 0):
            more = p[AMPLITUDE] if p[TARGET] == 2 else 0.0
            low = _current(p, _tick(p, x, p[AMPLITUDE]), 0.0, -more)
            high = _current(p, _tick(p, x, -p[AMPLITUDE]), 0.0, more)
            worst = max(abs(low), abs(high), abs(sent[h % _MEMORY])) * p[AMPERE]
            if worst <= p[COULOMB]:
                out[0] = RESTS
                return
        place = x
        if part > 0:
            x, v = _through(p, x, v, sent[(h - whole - 1) % _MEMORY], part * period, EARLY, loop, ends)
        x, v = _through(p, x, v, sent[(h - whole) % _MEMORY], (1 - part) * period, LATE, loop, ends)
        stood = stood + 1 if v == 0.0 and x == place else 0
        ends[0], ends[1] = min(ends[0], x), max(ends[1], x)
        if v != 0.0:
            turns += heading * v < 0.0
            heading = math.copysign(1.0, v)
        if not abs(x) < _FAR * delta:
            out[0], out[1] = MOVES_ON, np.inf
            return
        if h + 1 == check and closing == 0:
            size = 0.5 * (ends[1] - ends[0]) / delta
            out[1] = size
            ends[0] = ends[1] = x
            if size < 1e-9 and p[WAVE] != 3:
                out[0] = RESTS
                return
            if turns > 1 and size < 0.7 and 0.98 * before_it < size < 1.02 * before_it:
                out[0] = BUZZES
                return
            if check >= horizon:
                # what shrinks above a tick, grows below one, or creeps one way is followed on, in windows that double
                if turns > 1 and (size <= 1.1 * before_it if size < 1.0 else size > 0.999 * before_it):
                    out[0] = BUZZES if size < 1.0 else MOVES_ON
                    return
                out[0] = UNDECIDED
            before_it, turns = size, 0
            check *= 2


@numba.njit(nogil=True, cache=True)
def _run_all(p: Any, starts: Any, horizon: int, out: Any) -> None:
    for k in range(len(starts)):
        _run(p, starts[k], horizon, out[k])


def runs(config: Any, starts: Floats, horizon: int = 16_000) -> Floats:
    """What becomes of starts.

    Args:
        config: the configuration. starts: (n, 4) place in ticks, speed in ticks per period, whether the servo has seen the
            shaft come at that speed (1) or nothing (0), phase of the dither in turns.
        horizon: periods, a multiple of 8.

    Returns:
        (n, 2): RESTS … UNDECIDED, and the amplitude in ticks at the end.
    """
    out = np.zeros((len(starts), 2))
    _run_all(numbers_of(config), np.ascontiguousarray(starts), horizon, out)
    return out


def starts_within(
    config: Any, motion: tuple[float, float] | None, count: int, rng: np.random.Generator, memory: bool = True
) -> Floats:
    """(count, 4) starts drawn over the energies up to that of a motion, or up to ``safety.max_velocity``."""
    p = numbers_of(config)
    heavy = math.sqrt(p[MASS] / (p[STIFFNESS] * p[PERIOD] ** 2))
    if motion is None:
        largest = heavy * (config.safety.max_velocity or 1e3) * p[PERIOD] / (p[COUNT] * p[DECIMATION])
    else:
        largest = math.hypot(motion[0], heavy * motion[1])
    share = rng.random(count)
    size = np.where(rng.random(count) < 0.7, min(0.2, largest) ** (1 - share) * largest**share, largest * share)
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    place, speed = size * np.cos(angle), size * np.sin(angle) / heavy
    released = rng.random(count) < 0.3
    place[released], speed[released] = size[released] * np.sign(place[released]), 0.0
    known = (rng.random(count) < 0.4) & memory
    found = np.column_stack([place, speed, known, rng.random(count)])
    if motion is not None:
        found[0] = *motion, 0.0, 0.0
    return found
