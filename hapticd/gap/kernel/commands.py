"""Motor currents from the commands of a record, divided at the instants of change."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import types

from hapticd.jit import njit
from hapticd.plant.electrical import delivered, lagged
from hapticd.plant.layout import index_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

_f8 = types.float64
_a = types.Array(_f8, 1, "C")
_m = types.Array(_f8, 2, "C")

_LAG, _LAG_DAMPING = index_of("amplifier_lag.f_a"), index_of("amplifier_lag.delta")


@njit(types.void(_a, _a, _a, _a, _f8, _m, _m, _m))
def segments(
    p: NDArray[Any],
    time_s: NDArray[Any],
    command: NDArray[Any],
    deviation: NDArray[Any],
    delay: float,
    duration: NDArray[Any],
    current: NDArray[Any],
    spread: NDArray[Any],
) -> None:
    """Divide each period where a delayed command takes effect.

    Args:
        p: device vector: converter and limit. time_s, command: (n,) record. delay: of the command [s].
        deviation: (n,) standard deviation of the effective command.
        duration, current, spread: (n, S) out; parts beyond S are averaged into the last.
    """
    n, parts = duration.shape
    following = 0
    aim, doubt = delivered(p, command[0]), deviation[0]
    for k in range(n):
        now = time_s[k]
        end = time_s[k + 1] if k + 1 < n else now + (now - time_s[k - 1])
        part = 0
        charge = weight = doubts = 0.0
        while True:
            due = end
            if following < n and time_s[following] + delay < end:
                due = max(time_s[following] + delay, now)
            span = due - now
            if part == parts - 1:
                charge += aim * span
                doubts += doubt * span
                weight += span
            elif span > 0.0:
                duration[k, part], current[k, part], spread[k, part] = span, aim, doubt
                part += 1
            now = due
            if due >= end:
                break
            aim, doubt = delivered(p, command[following]), deviation[following]
            following += 1
        for j in range(part, parts):
            duration[k, j], current[k, j], spread[k, j] = 0.0, aim, doubt
        if weight > 0.0:
            last = parts - 1
            duration[k, last], current[k, last], spread[k, last] = weight, charge / weight, doubts / weight


@njit(types.void(_a, _m, _m, _m))
def lagging(p: NDArray[Any], duration: NDArray[Any], aim: NDArray[Any], current: NDArray[Any]) -> None:
    """Two currents for the halves of each period that move a free mass like the lagging current.

    They give the same velocity, by the current's mean, and the same displacement, by the mean of its integral Q: with e = i
    − aim and e″ + 2δω e′ + ω² e = 0, ∫∫ e = −(Δe − e′ t + 2δω (∫ e − e t)) / ω².

    Args:
        p: device vector: the lag. duration, aim: (n, S) parts of each period and their set points, from `segments`.
        current: (n, 2) out [A].
    """
    n, parts = duration.shape
    natural, damping = 2.0 * math.pi * p[_LAG], p[_LAG_DAMPING]
    motor, rate = aim[0, 0], 0.0
    for k in range(n):
        whole = charge = way = 0.0
        for j in range(parts):
            span = duration[k, j]
            if span > 0.0:
                error, slope = motor - aim[k, j], rate
                motor, rate, part = lagged(p, motor, rate, aim[k, j], span)
                bend = motor - aim[k, j] - error - slope * span
                bend += 2.0 * damping * natural * (part - (aim[k, j] + error) * span)
                way += charge * span + 0.5 * aim[k, j] * span**2 - bend / natural**2
                charge += part
                whole += span
        mean, reach = charge / whole, way / whole**2
        current[k, 0], current[k, 1] = 4.0 * reach - mean, 3.0 * mean - 4.0 * reach


@njit(types.void(_a, _f8, _a, _a))
def in_force(command: NDArray[Any], loss: float, mean: NDArray[Any], deviation: NDArray[Any]) -> None:
    """Mean and standard deviation of the effective command, if each is lost with a probability and the last one stays.

    Args:
        command: (n,) as sent. loss: probability. mean, deviation: (n,) out.
    """
    m, variance = command[0], 0.0
    for k in range(len(command)):
        new = (1.0 - loss) * command[k] + loss * m
        variance = (1.0 - loss) * (command[k] - new) ** 2 + loss * (variance + (m - new) ** 2)
        m = new
        mean[k], deviation[k] = m, np.sqrt(variance)
