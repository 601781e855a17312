"""Bounds of the inertia, for any friction, gravity and cogging.

    K_t i(t − T_D) = J a + g(v) + f(x) + e

Functions of speed and position are regressed out of both torque and acceleration (Robinson 1988, Econometrica 56). The two
residuals are proportional, up to other forces e. These make the slope of torque over acceleration too small, and the inverse
slope of acceleration over torque too large: J is between the two (Frisch 1934; Klepper and Leamer 1984).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.balance import NEAR_LEAST, delays, smoothed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.gap.arrays import Floats
    from hapticd.gap.balance import Smoothed
    from hapticd.gap.recording import Recording

_SPEEDS, _PLACES, _ANGLES = 6, 24, 121
"""Numbers of knots of the functions of speed (per direction), of position, and of the angle within a turn."""
_RIDGE = 1e-4
_EARLIEST_PERIODS = 4.0
"""Largest lateness of a record of the current that is tried [periods]."""


@dataclass(frozen=True)
class InertiaRange:
    """Bounds of an inertia, kg m² or kg.

    Attributes:
        low: least value; 0 where acceleration has no information. high: largest; infinite where torque has none.
        left: RMS of the residual force, N m or N.
    """

    low: float
    high: float
    left: float


def inertia_range(recordings: Sequence[Recording], torque_constant: float) -> InertiaRange:
    """The range of the inertia, narrowed by the range with functions of speed only where the two overlap.

    Args:
        recordings: of one device, in which the shaft moves. torque_constant: K_t, N m/A or N/A.
    """
    parts = [smoothed(recording, torque_constant) for recording in recordings]
    speed = np.concatenate([part.velocity[part.taken] for part in parts])
    direction = np.concatenate([part.direction[part.taken] for part in parts])
    place = np.concatenate([part.position[part.taken] for part in parts])
    friction = [direction[:, None], speed[:, None], np.ones((speed.size, 1))]
    for way in (1.0, -1.0):
        fast = way * speed > 0.0
        knots = (
            np.unique(np.quantile(np.abs(speed[fast]), np.linspace(0.0, 1.0, _SPEEDS))) if fast.any() else np.empty(0)
        )
        if knots.size > 2:
            friction.append(_hats(np.abs(speed), knots) * fast[:, None])
    places = [_hats(place, np.linspace(place.min(), place.max(), _PLACES))]
    if not recordings[0].is_linear and np.ptp(place) > 2.0 * math.pi:
        places.append(_hats(np.mod(place, 2.0 * math.pi), np.linspace(0.0, 2.0 * math.pi, _ANGLES)))
    of_friction = _bounds(parts, np.concatenate(friction, axis=1))
    both = _bounds(parts, np.concatenate([*friction, *places], axis=1))
    low, high = max(of_friction.low, both.low), min(of_friction.high, both.high)
    return InertiaRange(low, high, both.left) if low < high else both


def _hats(values: Floats, knots: Floats) -> Floats:
    """(n, k) piecewise linear functions, each 1 at one of the knots and 0 at the others."""
    return np.stack([np.interp(values, knots, one) for one in np.eye(knots.size)], axis=1)


def _bounds(parts: Sequence[Smoothed], functions: Floats) -> InertiaRange:
    """The two slopes, over all delays that are about as good as the best."""
    period_s = parts[0].period_s
    tried = np.concatenate([-np.arange(period_s, _EARLIEST_PERIODS * period_s, 0.5 * period_s), delays(period_s)])
    torque = np.concatenate(
        [np.stack([part.torque_at(delay)[part.taken] for delay in tried], axis=1) for part in parts]
    )
    acceleration = np.concatenate([part.acceleration[part.taken] for part in parts])
    columns = functions / (np.sqrt(np.mean(functions**2, axis=0)) + 1e-300)
    normal = columns.T @ columns + _RIDGE * acceleration.size * np.eye(columns.shape[1])

    def rest(values: Floats) -> Floats:
        return np.asarray(values - columns @ np.linalg.solve(normal, columns.T @ values))

    a, y = rest(acceleration), rest(torque)
    both, square = a @ y, float(a @ a)
    low = both / square
    left = np.sqrt(np.mean((y - a[:, None] * low) ** 2, axis=0))
    as_little = left <= NEAR_LEAST * left.min()
    high = np.where(both > 0.0, np.sum(y**2, axis=0) / np.where(both > 0.0, both, 1.0), np.inf)
    return InertiaRange(max(float(low[as_little].min()), 0.0), float(high[as_little].max()), float(left.min()))
