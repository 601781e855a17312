"""One trajectory against the theorem, compiled: does energy fall, and do the bounds it presupposes hold?

The theorem (Sec. VI; `hapticd.stability.criterion`) says of every period, from the arrival of a sample's force at
l = h + τ_D to the next arrival, that H_T never exceeds H_T(l), provided that |ξ̇| ≤ ξ̇_max and |ξ̈| ≤ ξ̈_max (20). Energy is
looked at when each force arrives and, with a fractional delay, at the sample in between.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.jit import njit
from hapticd.plant.exact import phi_functions, step
from hapticd.stability.map_kernel import START, energy, run_point
from hapticd.stability.outcome import RISE_TOLERANCE, STRETCHES

FloatArray = NDArray[np.float64]

#: Columns of the counts that `check_all` fills.
RISES: Final = 0
FIRST_RISE: Final = 1
PERIODS: Final = 2
REASON: Final = 3
ROSE: Final = 4
#: Columns of its extremes.
TOP_SPEED: Final = 0
TOP_ACCELERATION: Final = 1
LARGEST_RISE: Final = 2


@njit()
def check_one(
    mu: float,
    beta: float,
    sigma: float,
    tau_d: float,
    xi: float,
    xi_dot: float,
    periods: int,
    ring: FloatArray,
    counts: NDArray[Any],
    extremes: FloatArray,
) -> None:
    """Run until rest or the horizon; `counts` up to PERIODS and `extremes` are filled.

    The acceleration is bounded from above by (|φ − βξ̇| + σ)/μ at the start of every stretch of constant force, within
    which neither speed nor acceleration can exceed its values at the ends.
    """
    whole = math.floor(tau_d)
    fraction = tau_d - whole
    rest = 1.0 - fraction
    e0, a0, b0 = phi_functions(-beta * fraction / mu)
    e1, a1, b1 = phi_functions(-beta * rest / mu)
    pending = ring.size
    ring[:] = 0.0
    slot = 0
    x, v = xi, xi_dot
    rises, first, largest = 0, -1, -np.inf
    speed, acceleration = abs(v), 0.0
    arrived = np.inf
    h = 0
    while h < periods:
        if v == 0.0:
            held = abs(math.floor(x) + 0.5) <= sigma
            for k in range(pending):
                held = held and abs(ring[k]) <= sigma
            if held:
                break
        oldest = ring[slot]
        ring[slot] = -math.floor(x) - 0.5
        slot = (slot + 1) % pending
        top = 0.0
        if fraction > 0.0:
            top = energy(x, v, mu)
            acceleration = max(acceleration, (abs(oldest - beta * v) + sigma) / mu)
            x, v = step(x, v, fraction, oldest, mu, beta, sigma, e0, a0, b0)
            speed = max(speed, abs(v))
        now = energy(x, v, mu)
        if h > whole:
            top = max(top, now)
            rise = (top - arrived) / arrived if arrived > 0.0 else 0.0
            largest = max(largest, rise)
            if rise > RISE_TOLERANCE:
                rises += 1
                if first < 0:
                    first = h
        arrived = now
        acceleration = max(acceleration, (abs(ring[slot] - beta * v) + sigma) / mu)
        x, v = step(x, v, rest, ring[slot], mu, beta, sigma, e1, a1, b1)
        speed = max(speed, abs(v))
        h += 1
    counts[RISES], counts[FIRST_RISE], counts[PERIODS] = rises, first, h
    extremes[TOP_SPEED], extremes[TOP_ACCELERATION], extremes[LARGEST_RISE] = speed, acceleration, largest


@njit()
def check_all(
    mu: FloatArray,
    beta: FloatArray,
    sigma: FloatArray,
    tau_d: FloatArray,
    xi: FloatArray,
    xi_dot: FloatArray,
    periods: int,
    fate_periods: int,
    counts: NDArray[Any],
    extremes: FloatArray,
    peaks: FloatArray,
) -> None:
    """Check (n,) trajectories, and run each once more to its fate, by the rules of the region maps.

    Args:
        mu: (n,) inertia μ.
        beta: (n,).
        sigma: (n,).
        tau_d: (n,).
        xi: (n,) initial position in ticks.
        xi_dot: (n,) initial velocity in ticks per period.
        periods: horizon of the energy check.
        fate_periods: horizon of the run to the fate.
        counts: (n, 5) int64 out: number of rises, period of the first (−1), periods run, why the second run ended
            (`map_kernel`), whether energy rose in it.
        extremes: (n, 3) out: largest speed, largest acceleration, largest relative change of energy in a period.
        peaks: (n, STRETCHES) out, see `map_kernel.run_point`.
    """
    starts = np.zeros(mu.size, START)
    for i in range(mu.size):
        pending = math.floor(tau_d[i]) + 1
        ring, saved, no_escape = np.zeros(pending), np.zeros(pending), np.zeros((2, 2 + pending))
        check_one(mu[i], beta[i], sigma[i], tau_d[i], xi[i], xi_dot[i], periods, ring, counts[i], extremes[i])
        start = starts[i]
        start.beta, start.sigma, start.xi, start.xi_dot, start.threshold = beta[i], sigma[i], xi[i], xi_dot[i], np.inf
        reason, _, _, rose, _, _ = run_point(
            mu[i], tau_d[i], start, fate_periods, True, no_escape, ring, saved, peaks[i]
        )
        counts[i, REASON], counts[i, ROSE] = reason, int(rose)


def work_space(count: int) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """The three arrays that `check_all` fills."""
    return np.zeros((count, 5), np.int64), np.zeros((count, 3)), np.zeros((count, STRETCHES))
