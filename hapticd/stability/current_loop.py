"""The amplifier's current loop, i″ = ω²(u − i) − 2δω i′: its motion from command to command, and what it costs the theorems.

Theory sees it as the delay T_A = 2δ/ω of (5); what is *proven* (`lagged`) and what is explored have its second order. With
z = (i − u, i′/ω) and the command u held, z′ = Mz with M = [[0, ω], [−ω, −2δω]], and |z| never grows. A mass that slides one
way, v′ = (u − sσ + z₁)/μ − rv with r = β/μ, then has the closed form

    v = pz + (v₀ − pz₀)e^(−rτ) + …,      x = x₀ + m(z − z₀) + (v₀ − pz₀)τφ₁ + …,      p(M + rI) = (1, 0)/μ,   m = pM⁻¹,

where … is the motion under the constant force u − sσ. It is taken wherever no stop is possible, by how fast the mass is and
|u| + |z|, the largest that |i| may be. Elsewhere a period is divided, and in the parts in which a stop may be the current is
its exact mean.
"""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numba import types

from hapticd.effects import amplifier_lag
from hapticd.jit import njit
from hapticd.plant.exact import phi_functions, step, time_and_way_to_rest
from hapticd.plant.spring import propagate_with_stiffness, spring_functions
from hapticd.stability.criterion import lambda_

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.stability.numbers import Loop

_f8 = types.float64
#: Grid of the impulse response, and what its error is rounded up by.
_POINTS, _ROUNDING = 20_000, 1.0 + 1e-3
#: Fewest and most parts of a period; between them one for so many rad of ω.
_FEWEST, _MOST, _PHASE = 6, 32, 0.7
#: Relative distance from a resonance of friction and current loop, at which p is infinite, and what is added to δ there.
_SINGULAR, _ASIDE = 1e-6, 1e-5
#: What a current loop has forgotten, and how little of it.
_FORGOTTEN: Final = 14.0

#: A span of the period as `prepared` has it.
_SPAN, _PARTS, _WHOLE, _PART, _OMEGA, _TWICE, _P, _M = 0, 4, 5, 12, 19, 20, 21, 23
SPAN_WORDS: Final = 25


def current_loop(config: Config, loop: Loop) -> tuple[float, float, float]:
    """What of a loop's delay is a current loop of second order: the effect ``amplifier_lag``, else the amplifier itself.

    Args:
        config: the configuration. loop: it in SI units, or another loop of the same kind.

    Returns:
        The delay that is left before it (periods), ω (rad per period, 0 where there is none) and δ.
    """
    hertz, ratio = config.amplifier.bandwidth_hz, config.amplifier.damping_ratio
    for listed in config.plant.effects:
        if listed.name == amplifier_lag.EFFECT.slug:
            values = amplifier_lag.EFFECT.complete(listed.model_extra or {})
            hertz, ratio = float(values["f_a"]), float(values["delta"])
    if not hertz:
        return loop.delay / loop.period, 0.0, ratio
    own = ratio / (math.pi * hertz)
    # a delay of whole periods must not become one of a whole period less a rounding
    return round(max(0.0, loop.delay - own) / loop.period, 12), 2.0 * math.pi * hertz * loop.period, ratio


@functools.lru_cache(maxsize=256)
def lagged(tau: float, natural: float, damping: float, beta_v: float = 0.0) -> tuple[float, float, float]:
    """λ, the gain of q, and the lateness of a first force, of a current loop of second order behind a delay.

    Its force is a mixture of delays, weighted with its impulse response a(θ): each delay τ + θ puts in at most
    λ(τ + θ)∫ξ̇², whatever the sign of its weight.

    Args:
        tau: the delay before it, periods. natural: ω_A, rad per period. damping: δ_A. beta_v: virtual damping.

    Returns:
        ∫|a|λ(τ + θ)dθ, ∫|a|dθ and ∫|1 − s|dθ with the step response s, a little rounded up.
    """
    slowest = damping if damping <= 1.0 else 1.0 / (damping + math.sqrt(damping * damping - 1.0))
    step = 25.0 / slowest / _POINTS
    x = step * (np.arange(_POINTS) + 0.5)
    root = np.sqrt(complex(damping * damping - 1.0))
    if abs(root) < 1e-6:
        root = 1e-6 + 0.0j  # the critically damped loop, to 12 digits
    fast, slow = damping + root, damping - root
    impulse = ((np.exp(-slow * x) - np.exp(-fast * x)) / (2.0 * root)).real
    rest = ((fast * np.exp(-slow * x) - slow * np.exp(-fast * x)) / (2.0 * root)).real
    weight = np.abs(impulse) * step * _ROUNDING
    lam = float(weight @ lambda_(tau + x / natural, beta_v))
    return lam, float(weight.sum()), float(np.abs(rest).sum() * step / natural) * _ROUNDING


@njit(types.int64(_f8, _f8))
def forgets(natural: float, damping: float) -> int:
    """Periods after which a current loop remembers a millionth of how it was; 0 without one."""
    if natural == 0.0:
        return 0
    slowest = damping if damping <= 1.0 else 1.0 / (damping + math.sqrt(damping * damping - 1.0))
    return math.ceil(_FORGOTTEN / (slowest * natural))


@njit(_f8(_f8))
def overshoot(damping: float) -> float:
    """∫|a| of its impulse response: how much farther the current swings than commands that change as they like."""
    if damping >= 1.0:
        return 1.0
    first = math.exp(-math.pi * damping / math.sqrt(1.0 - damping * damping))
    return (1.0 + first) / (1.0 - first)


@njit(types.void(_f8, _f8, _f8, _f8, _f8, _f8[::1]))
def prepare(natural: float, damping: float, mu: float, beta: float, span: float, made: Any) -> None:
    """Work out ``made`` (SPAN_WORDS,), what `lagged_motion` goes by in a span of a period."""
    rate = beta / mu
    det = natural * natural - 2.0 * damping * natural * rate + rate * rate
    if abs(det) < _SINGULAR * natural * natural:
        damping *= 1.0 + _ASIDE
        det = natural * natural - 2.0 * damping * natural * rate + rate * rate
    parts = math.ceil(span * min(max(natural / _PHASE, float(_FEWEST)), float(_MOST)) - 1e-9)
    made[_PARTS] = parts
    for first, length in ((_WHOLE, span), (_PART, span / max(parts, 1))):
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
    """Where a mass that is being slowed down comes to its first rest."""
    sign = math.copysign(1.0, v)
    _, way = time_and_way_to_rest(abs(v), (sigma - sign * force) / mu, beta / mu)
    return x + sign * way


@njit(inline=True)
def held_motion(
    x: float, v: float, dt: float, force: float, mu: float, beta: float, sigma: float, kappa: float,
    exponential: float, phi1: float, phi2: float,
) -> tuple[float, float]:  # fmt: skip
    """Move through a time of constant force, which has these `phi_functions`."""
    if kappa > 0.0:
        return propagate_with_stiffness(x, v, dt, force, mu, beta, sigma, kappa)
    return step(x, v, dt, force, mu, beta, sigma, exponential, phi1, phi2)


@njit(inline=True)
def _slid(
    x: float, v: float, aim: float, off: float, rate: float, span: float, at: int,
    mu: float, beta: float, sigma: float, kappa: float, made: Any,
) -> tuple[float, float, float, float, bool]:  # fmt: skip
    """Place, speed and current loop after a span in which nothing stops, and whether that is certain; ``at`` it in `made`."""
    away, after = made[at + 3] * off + made[at + 4] * rate, made[at + 5] * off + made[at + 6] * rate
    most = abs(aim - kappa * x) + math.sqrt(off * off + rate * rate)
    if v == 0.0 or kappa > 0.0:
        return x, 0.0, away, after, v == 0.0 and most <= sigma
    g = (aim - math.copysign(sigma, v)) / mu
    own = made[_P] * off + made[_P + 1] * rate
    end = made[at] * (v - own) + span * made[at + 1] * g + made[_P] * away + made[_P + 1] * after
    most = (most + sigma) / mu
    most += beta / mu * (abs(v) + span * most)
    way = span * (made[at + 1] * (v - own) + span * made[at + 2] * g)
    way += made[_M] * (away - off) + made[_M + 1] * (after - rate)
    return x + way, end, away, after, end * v > 0.0 and abs(end) + abs(v) > span * most


@njit(types.UniTuple(_f8, 6)(_f8, _f8, _f8, _f8, _f8, _f8, _f8, _f8, _f8, _f8[::1]))
def lagged_motion(
    x: float, v: float, force: float, rate: float, aim: float, mu: float, beta: float, sigma: float, kappa: float,
    made: Any,
) -> tuple[float, float, float, float, float, float]:  # fmt: skip
    """Move mass and current loop through a span of constant command.

    Args:
        x, v: place and speed. force: that of the current. rate: its derivative over ω. aim: the command, as a force.
        mu, beta, sigma, kappa: of the mass. made: of the span, by `prepare`.

    Returns:
        Place, speed, force and rate after it, and the lowest and highest place on the way.
    """
    off = force - aim
    place, end, away, after, sure = _slid(x, v, aim, off, rate, made[_SPAN], _WHOLE, mu, beta, sigma, kappa, made)
    if sure:
        return place, end, aim + away, after, min(x, place), max(x, place)
    low = high = x
    length = made[_SPAN] / made[_PARTS]
    for _ in range(int(made[_PARTS])):
        place, end, away, after, sure = _slid(x, v, aim, off, rate, length, _PART, mu, beta, sigma, kappa, made)
        if sure:
            x, v = place, end
        else:
            mean = aim - (made[_TWICE] * (away - off) + after - rate) / (made[_OMEGA] * length)
            before, speed = x, v
            x, v = held_motion(x, v, length, mean, mu, beta, sigma, kappa, made[_PART], made[_PART + 1], made[_PART + 2])
            if v * speed < 0.0 and kappa == 0.0:
                turn = stop_of(before, speed, mean, mu, beta, sigma)
                low, high = min(low, turn), max(high, turn)
        low, high = min(low, x), max(high, x)
        off, rate = away, after
    return x, v, aim + off, rate, low, high
