"""The normal density in one of the encoder's cells, and in a tail."""

from __future__ import annotations

import math

from numba import types

from hapticd.jit import njit

_f8 = types.float64
SURE = 7.0
"""Standard deviations beyond which there is no tail. With four, the likelihood jumped by several nats where a breakaway
became that unlikely, and the maximisation stopped there."""
_ROOT_2 = math.sqrt(2.0)
_DENSITY_0 = 1.0 / math.sqrt(2.0 * math.pi)


@njit(types.UniTuple(_f8, 4)(_f8, _f8), inline=True)
def truncated(low: float, high: float) -> tuple[float, float, float, float]:
    """Return the mass m e^s of the standard normal in [low, high] as m and s, and its mean and variance there."""
    sign = 1.0
    if low > 0.0:
        sign, low, high = -1.0, -high, -low
    if high < -5.0:  # in the far tail the density decays exponentially from the near edge
        k, width = -high, high - low
        e = math.exp(-k * width) if k * width < 50.0 else 0.0
        mass = _DENSITY_0 / k * (1.0 - e - (1.0 - e) / (k * k))
        depth = 1.0 / k - (width * e / (1.0 - e) if e > 0.0 else 0.0)
        return mass, -0.5 * high * high, sign * (high - depth), min(1.0, 1.0 / (k * k))
    mass = max(0.5 * (math.erfc(-high / _ROOT_2) - math.erfc(-low / _ROOT_2)), 1e-300)
    at_low = _DENSITY_0 * math.exp(-0.5 * low * low)
    at_high = _DENSITY_0 * math.exp(-0.5 * high * high)
    mean = (at_low - at_high) / mass
    width = high - low
    if width < 1e-3:  # nearly a point: the closed form has cancellation
        return mass, 0.0, sign * 0.5 * (low + high), width * width / 12.0
    variance = 1.0 + (low * at_low - high * at_high) / mass - mean * mean
    return mass, 0.0, sign * mean, min(max(variance, 1e-9), 1.0)


@njit(types.UniTuple(_f8, 2)(_f8), inline=True)
def lower_tail(high: float) -> tuple[float, float]:
    """Return the mass of the standard normal below `high` and its density there; 0 beyond `SURE` deviations."""
    if high < -SURE:
        return 0.0, 0.0
    if high > SURE:
        return 1.0, 0.0
    return 0.5 * math.erfc(-high / _ROOT_2), _DENSITY_0 * math.exp(-0.5 * high * high)
