"""One point of a region map, compiled: the loop of eq. 7–9 from sample to sample, exactly, until its outcome is certain.

The step is that of `hapticd.plant.exact`; as period and friction do not change during a run, its exponentials are
computed once a run. A run ends before its horizon only for a reason that settles its outcome for ever:

* rest: the mass stands and the forces to come, delayed ones included, are all held by stiction; or it slides to its rest
  within the present tick, under a force that stiction holds and that can therefore not change any more (at σ = ½ the
  net force can be zero, and the slide takes for ever);
* recurrence: position, velocity and pending commands at a sample are bit for bit those of an earlier sample; the loop
  is deterministic, so it repeats from there (Brent's search: the reference moves on at powers of two);
* escape: the state is where growth can be proven (`hapticd.stability.escape`).

Energy is H_T (35), at the samples without delay and at h + τ_D with it, from the first command's arrival on.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.jit import njit
from hapticd.plant.exact import phi_functions, propagate, step, time_and_way_to_rest
from hapticd.stability.outcome import RISE_TOLERANCE, STRETCHES

FloatArray = NDArray[np.float64]

#: Why a run ended.
REST: Final = 0
RECURRED: Final = 1
ESCAPED: Final = 2
LEFT: Final = 3
HORIZON: Final = 4

#: Position in ticks at which a run ends as grown, if growth was not proven before.
LIMIT: Final = 1e9

#: Where a point is and its motion starts, ticks and ticks per period; `threshold` is that of `escape.Escape.threshold`.
START: Final = np.dtype([(name, "f8") for name in ("beta", "sigma", "xi", "xi_dot", "threshold")])

#: What became of it: `reason` and `cycle` (periods, 0: none found) as in `run_point`, where it ended, half of peak to peak
#: in ticks (0 at rest, infinite when it left) and ω in rad per period of what stays in motion.
END: Final = np.dtype(
    [
        *((name, "i8") for name in ("reason", "periods", "cycle", "rose")),
        *((name, "f8") for name in ("xi", "xi_dot", "amplitude", "omega")),
        ("peaks", "f8", STRETCHES),
    ]
)

# Escape and limit are looked at once in so many periods; a power of two.
_LOOK = 64


@njit(inline=True)
def energy(x: float, v: float, mu: float) -> float:
    """H_T (35) in units of KΔ²."""
    tick = math.floor(x)
    return 0.5 * mu * v * v + (0.5 * tick * tick + (tick + 0.5) * (x - tick))


@njit(inline=True)
def _held(ring: FloatArray, x: float, sigma: float) -> bool:
    """Whether stiction holds every force to come for a mass that stands at x."""
    held = abs(math.floor(x) + 0.5) <= sigma
    for k in range(ring.size):
        held = held and abs(ring[k]) <= sigma
    return held


@njit(inline=True)
def _resting_place(ring: FloatArray, x: float, v: float, mu: float, beta: float, sigma: float) -> float:
    """Where the mass is going to rest if no force changes before; not a number where that is not certain."""
    tick = math.floor(x)
    force = -tick - 0.5
    sign = math.copysign(1.0, v)
    if abs(force) > sigma:
        return np.nan
    for k in range(ring.size):
        if ring[k] != force:
            return np.nan
    _, way = time_and_way_to_rest(abs(v), (sigma - sign * force) / mu, beta / mu)
    stop = x + sign * way
    return stop if tick < stop < tick + 1.0 else np.nan


@njit()
def run_point(
    mu: float,
    tau_d: float,
    start: Any,
    periods: int,
    early: bool,
    growth: FloatArray,
    ring: FloatArray,
    saved: FloatArray,
    peaks: FloatArray,
) -> tuple[int, int, int, bool, float, float]:
    """Run one point of μ and τ_D, p commands under way; no force acts before the first of them arrives.

    Args:
        start: of `START`. periods: the horizon.
        early: end when the outcome is certain; otherwise only at the limit and the horizon.
        growth: (2, 2 + p) eigenvector of `hapticd.stability.escape.Escape`, real and imaginary part.
        ring: (p,) work space; holds the commands under way at the end, the oldest at ``periods run modulo p``.
        saved: (p,) work space. peaks: (STRETCHES,) out: largest energy in each stretch of the horizon's second half.

    Returns:
        reason, periods run, cycle length in periods (0 if none was found), whether energy ever rose, ξ, ξ̇ (at rest: of the
        resting place, even if it is reached later).
    """
    beta, sigma = start.beta, start.sigma
    whole = math.floor(tau_d)
    fraction = tau_d - whole
    rest = 1.0 - fraction
    e0, a0, b0 = phi_functions(-beta * fraction / mu)
    e1, a1, b1 = phi_functions(-beta * rest / mu)
    pending = ring.size
    ring[:] = 0.0
    peaks[:] = 0.0
    slot = 0
    half = periods // 2
    edge, stretch = half, -1
    peak, last = 0.0, np.inf
    rose = False
    x, v = start.xi, start.xi_dot
    reference, next_reference = 0, 1
    x_saved, v_saved = np.nan, np.nan
    limit2 = start.threshold * start.threshold
    h = 0
    while h < periods:
        if early:
            if v == 0.0 and _held(ring, x, sigma):
                return REST, h, 0, rose, x, v
            if x == x_saved and v == v_saved:
                same = True
                for k in range(pending):
                    same = same and ring[(slot + k) % pending] == saved[k]
                if same:
                    return RECURRED, h, h - reference, rose, x, v
            if h == next_reference:
                reference, next_reference = h, 2 * h
                x_saved, v_saved = x, v
                for k in range(pending):
                    saved[k] = ring[(slot + k) % pending]
        if h & (_LOOK - 1) == 0:
            if not abs(x) <= LIMIT:
                return LEFT, h, 0, rose, x, v
            if early:
                stop = _resting_place(ring, x, v, mu, beta, sigma)
                if stop == stop:
                    return REST, h, 0, rose, stop, 0.0
                real = growth[0, 0] * x + growth[0, 1] * v
                imaginary = growth[1, 0] * x + growth[1, 1] * v
                for k in range(pending):
                    real += growth[0, 2 + k] * ring[(slot + k) % pending]
                    imaginary += growth[1, 2 + k] * ring[(slot + k) % pending]
                if real * real + imaginary * imaginary > limit2:
                    return ESCAPED, h, 0, rose, x, v
        if h == edge:
            if stretch >= 0:
                peaks[stretch] = peak
            peak = 0.0
            stretch += 1
            edge = half + (stretch + 1) * (periods - half) // STRETCHES

        oldest = ring[slot]
        ring[slot] = -math.floor(x) - 0.5
        slot += 1
        if slot == pending:
            slot = 0
        if fraction > 0.0:
            x, v = step(x, v, fraction, oldest, mu, beta, sigma, e0, a0, b0)
        if h >= whole:
            now = energy(x, v, mu)
            rose = rose or now > last * (1.0 + RISE_TOLERANCE)
            last = now
            peak = max(peak, now)
        x, v = step(x, v, rest, ring[slot], mu, beta, sigma, e1, a1, b1)
        h += 1
    peaks[STRETCHES - 1] = peak
    if v == 0.0 and _held(ring, x, sigma):
        return REST, h, 0, rose, x, v
    stop = _resting_place(ring, x, v, mu, beta, sigma)
    if stop == stop:
        return REST, h, 0, rose, stop, 0.0
    return HORIZON, h, 0, rose, x, v


@njit()
def measure(
    mu: float,
    beta: float,
    sigma: float,
    tau_d: float,
    xi: float,
    xi_dot: float,
    periods: int,
    ring: FloatArray,
    slot: int,
) -> tuple[float, float]:
    """Amplitude and frequency of what a run has become, over so many periods more, turning points located exactly.

    Returns:
        Half of peak to peak in ticks; ω in rad per period, π times the mean number of reversals a period.
    """
    whole = math.floor(tau_d)
    fraction = tau_d - whole
    pending = ring.size
    x, v = xi, xi_dot
    low, high = x, x
    reversals = 0
    heading = 0.0 if v == 0.0 else math.copysign(1.0, v)
    for _ in range(periods):
        oldest = ring[slot]
        ring[slot] = -math.floor(x) - 0.5
        slot = (slot + 1) % pending
        for part in range(2):
            dt = 1.0 - fraction if part else fraction
            force = ring[slot] if part else oldest
            if dt == 0.0:
                continue
            x_before, v_before = x, v
            x, v = propagate(x, v, dt, force, mu, beta, sigma)
            if v_before != 0.0 and v * v_before <= 0.0:
                turn = turning_point(x_before, v_before, force, mu, beta, sigma)
                low, high = min(low, turn), max(high, turn)
            low, high = min(low, x), max(high, x)
            if v != 0.0:
                reversals += int(heading * v < 0.0)
                heading = math.copysign(1.0, v)
    return 0.5 * (high - low), math.pi * reversals / periods


@njit()
def turning_point(x: float, v: float, force: float, mu: float, beta: float, sigma: float) -> float:
    """Where a mass that is being slowed down comes to its first rest."""
    sign = math.copysign(1.0, v)
    _, way = time_and_way_to_rest(abs(v), (sigma - sign * force) / mu, beta / mu)
    return x + sign * way


@njit()
def run_points(
    mu: float, tau_d: float, starts: Any, periods: int, early: bool, growth: NDArray[Any], ends: Any
) -> None:
    """Run (n,) points of one μ and τ_D, as `run_point` does, and measure what stays in motion.

    Args:
        starts: (n,) of `START`. growth: (n, 2, 2 + p). ends: (n,) of `END`, filled.
    """
    pending = math.floor(tau_d) + 1
    ring, saved = np.zeros(pending), np.zeros(pending)
    for i in range(len(starts)):
        start, end = starts[i], ends[i]
        reason, done, cycle, rose, x, v = run_point(mu, tau_d, start, periods, early, growth[i], ring, saved, end.peaks)
        amplitude, omega = 0.0, 0.0
        if reason in (RECURRED, HORIZON):
            window = cycle if cycle else max(periods // (2 * STRETCHES), 1)
            amplitude, omega = measure(mu, start.beta, start.sigma, tau_d, x, v, window, ring, done % pending)
        elif reason != REST:
            amplitude = np.inf
        end.reason, end.periods, end.cycle, end.rose = reason, done, cycle, rose
        end.xi, end.xi_dot, end.amplitude, end.omega = x, v, amplitude, omega
