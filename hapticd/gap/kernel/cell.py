"""The normal density in one of the encoder's cells."""

from __future__ import annotations

import math

from numba import types

from hapticd.jit import njit

_f8 = types.float64
_ROOT_2 = math.sqrt(2.0)
_DENSITY_0 = 1.0 / math.sqrt(2.0 * math.pi)


@njit(types.UniTuple(_f8, 3)(_f8, _f8))
def truncated(low: float, high: float) -> tuple[float, float, float]:
    """Return log mass, mean and variance of the standard normal truncated to [low, high]."""
    sign = 1.0
    if low > 0.0:
        sign, low, high = -1.0, -high, -low
    if high < -5.0:  # the far tail decays exponentially from the near edge
        k, width = -high, high - low
        e = math.exp(-k * width) if k * width < 50.0 else 0.0
        log_mass = -0.5 * high * high - math.log(k / _DENSITY_0) + math.log1p(-e - (1.0 - e) / (k * k))
        depth = 1.0 / k - (width * e / (1.0 - e) if e > 0.0 else 0.0)
        return log_mass, sign * (high - depth), min(1.0, 1.0 / (k * k))
    mass = max(0.5 * (math.erfc(-high / _ROOT_2) - math.erfc(-low / _ROOT_2)), 1e-300)
    at_low = _DENSITY_0 * math.exp(-0.5 * low * low)
    at_high = _DENSITY_0 * math.exp(-0.5 * high * high)
    mean = (at_low - at_high) / mass
    width = high - low
    if width < 1e-3:  # nearly a point: the closed form would subtract equal numbers
        return math.log(mass), sign * 0.5 * (low + high), width * width / 12.0
    variance = 1.0 + (low * at_low - high * at_high) / mass - mean * mean
    return math.log(mass), sign * mean, min(max(variance, 1e-9), 1.0)
