"""Exact motion of a mass behind a second-order current loop, i″ = ω²(u − i) − 2δω i′, from command to command.

With z = (i − u, i′/ω) and a constant command u, z′ = Mz with M = [[0, ω], [−ω, −2δω]], and |z| never grows. A mass that
slides in one direction, v′ = (u − sσ + z₁)/μ − rv with r = β/μ, then has the closed form

    v = pz + (v₀ − pz₀)e^(−rτ) + …,      x = x₀ + m(z − z₀) + (v₀ − pz₀)τφ₁ + …,      p(M + rI) = (1, 0)/μ,   m = pM⁻¹,

where … is the motion under the constant force u − sσ. It is used if no stop is possible, which follows from the speed and
from |u| + |z|, the largest |i|. Otherwise the time is divided into parts; in those with a possible stop, or with a
hand's stiffness, the current is its exact mean.

All functions work in any consistent system of units: SI, or the paper's ticks and periods. Forces stand for currents.
"""

from __future__ import annotations

import math
from typing import Any, Final

from numba import types

from hapticd.jit import njit
from hapticd.plant.exact import phi_functions, step, time_and_distance_to_rest
from hapticd.plant.spring import propagate_with_stiffness, spring_functions

_f8 = types.float64
#: Fewest and most parts of a period, and rad of ω per part between them.
_FEWEST, _MOST, _PHASE = 6, 32, 0.7
#: Relative distance from r = a pole of the current loop, where p is infinite, and the change of δ there.
_SINGULAR, _ASIDE = 1e-6, 1e-5
#: A current loop's transient counts as over when it has decayed to e to the minus this.
_FORGOTTEN: Final = 14.0
_ROUNDING: Final = 1e-9

# Indices in a prepared span: φ functions and transition of the whole span, and of one of its parts.
_SPAN, _PARTS, _WHOLE, _PART, _OMEGA, _TWICE, _P, _M = 0, 1, 2, 9, 16, 17, 18, 20
SPAN_WORDS: Final = 22


@njit(types.int64(_f8, _f8))
def forgets(natural: float, damping: float) -> int:
    """Periods after which the transient of a current loop has decayed to a millionth; 0 without one."""
    if natural == 0.0:
        return 0
    slowest = damping if damping <= 1.0 else 1.0 / (damping + math.sqrt(damping * damping - 1.0))
    return math.ceil(_FORGOTTEN / (slowest * natural))


@njit(_f8(_f8))
def overshoot(damping: float) -> float:
    """∫|a| of its impulse response a: largest ratio of current to command, for any commands."""
    if damping >= 1.0:
        return 1.0
    first = math.exp(-math.pi * damping / math.sqrt(1.0 - damping * damping))
    return (1.0 + first) / (1.0 - first)


@njit(_f8(_f8, _f8))
def parts_per_time(natural: float, period: float) -> float:
    """Parts per unit of time if a stop is possible, for a current loop and a servo period."""
    return min(max(natural * period / _PHASE, float(_FEWEST)), float(_MOST)) / period


@njit(types.void(_f8, _f8, _f8, _f8, _f8, _f8, _f8[::1]))
def prepare(natural: float, damping: float, mu: float, beta: float, finest: float, span: float, made: Any) -> None:
    """Compute ``made`` (SPAN_WORDS,), the coefficients of `lagged_motion` for a span; ``finest`` from `parts_per_time`."""
    rate = beta / mu
    det = natural * natural - 2.0 * damping * natural * rate + rate * rate
    if abs(det) < _SINGULAR * natural * natural:
        damping *= 1.0 + _ASIDE
        det = natural * natural - 2.0 * damping * natural * rate + rate * rate
    parts = max(math.ceil(span * finest - _ROUNDING), 1)
    made[_PARTS] = parts
    for first, length in ((_WHOLE, span), (_PART, span / parts)):
        made[first], made[first + 1], made[first + 2] = phi_functions(-rate * length)
        end_rate, s, c = spring_functions(length, damping * natural, natural * natural)
        made[first + 3], made[first + 4] = 1.0 - natural * natural * c, natural * s
        made[first + 5], made[first + 6] = -natural * s, end_rate
    made[_SPAN], made[_OMEGA], made[_TWICE] = span, natural, 2.0 * damping
    made[_P], made[_P + 1] = -(2.0 * damping * natural - rate) / (mu * det), -natural / (mu * det)
    made[_M] = (made[_P + 1] - 2.0 * damping * made[_P]) / natural
    made[_M + 1] = -made[_P] / natural


@njit(inline=True)
def stop_of(x: float, v: float, force: float, mu: float, beta: float, sigma: float) -> float:
    """Position of the first stop of a decelerating mass."""
    sign = math.copysign(1.0, v)
    _, distance = time_and_distance_to_rest(abs(v), (sigma - sign * force) / mu, beta / mu)
    return x + sign * distance


@njit(inline=True)
def held_motion(
    x: float, v: float, dt: float, force: float, mu: float, beta: float, sigma: float, kappa: float,
    exponential: float, phi1: float, phi2: float,
) -> tuple[float, float]:  # fmt: skip
    """Move through a time of constant force, with its `phi_functions`."""
    if kappa > 0.0:
        return propagate_with_stiffness(x, v, dt, force, mu, beta, sigma, kappa)
    return step(x, v, dt, force, mu, beta, sigma, exponential, phi1, phi2)


@njit(inline=True)
def _slid(
    x: float, v: float, aim: float, off: float, rate: float, span: float, at: int,
    mu: float, beta: float, sigma: float, kappa: float, made: Any,
) -> tuple[float, float, float, float, bool]:  # fmt: skip
    """Position, velocity and current loop after a span without a stop, and whether that holds; ``at``: index in `made`."""
    away, after = made[at + 3] * off + made[at + 4] * rate, made[at + 5] * off + made[at + 6] * rate
    most = abs(aim - kappa * x) + math.sqrt(off * off + rate * rate)
    if v == 0.0 or kappa > 0.0:
        return x, 0.0, away, after, v == 0.0 and most <= sigma
    g = (aim - math.copysign(sigma, v)) / mu
    own = made[_P] * off + made[_P + 1] * rate
    end = made[at] * (v - own) + span * made[at + 1] * g + made[_P] * away + made[_P + 1] * after
    most = (most + sigma) / mu
    most += beta / mu * (abs(v) + span * most)
    displacement = span * (made[at + 1] * (v - own) + span * made[at + 2] * g)
    displacement += made[_M] * (away - off) + made[_M + 1] * (after - rate)
    return x + displacement, end, away, after, end * v > 0.0 and abs(end) + abs(v) > span * most


@njit(types.UniTuple(_f8, 6)(_f8, _f8, _f8, _f8, _f8, _f8, _f8, _f8, _f8, _f8[::1]))
def lagged_motion(
    x: float, v: float, force: float, rate: float, aim: float, mu: float, beta: float, sigma: float, kappa: float,
    made: Any,
) -> tuple[float, float, float, float, float, float]:  # fmt: skip
    """Move mass and current loop through a span of constant command.

    Args:
        x, v: position and velocity. force: of the current. rate: its derivative over ω. aim: the command, as a force.
        mu, beta, sigma, kappa: of the mass. made: of the span, from `prepare`.

    Returns:
        Position, velocity, force and rate after it, and the lowest and highest position.
    """
    off = force - aim
    position, end, away, after, sure = _slid(x, v, aim, off, rate, made[_SPAN], _WHOLE, mu, beta, sigma, kappa, made)
    if sure or made[_SPAN] == 0.0:
        return position, end, aim + away, after, min(x, position), max(x, position)
    low = high = x
    length = made[_SPAN] / made[_PARTS]
    for _ in range(int(made[_PARTS])):
        position, end, away, after, sure = _slid(x, v, aim, off, rate, length, _PART, mu, beta, sigma, kappa, made)
        if sure:
            x, v = position, end
        else:
            mean = aim - (made[_TWICE] * (away - off) + after - rate) / (made[_OMEGA] * length)
            before, speed = x, v
            x, v = held_motion(
                x, v, length, mean, mu, beta, sigma, kappa, made[_PART], made[_PART + 1], made[_PART + 2]
            )
            if v * speed < 0.0 and kappa == 0.0:
                turn = stop_of(before, speed, mean, mu, beta, sigma)
                low, high = min(low, turn), max(high, turn)
        low, high = min(low, x), max(high, x)
        off, rate = away, after
    return x, v, aim + off, rate, low, high
