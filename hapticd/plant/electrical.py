"""From the commands of a record to the motor current: link, converter, limit, delay, current loop."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from numba import types

from hapticd.effects import current_saturation, dac_quantization
from hapticd.jit import effect_term, njit
from hapticd.plant.layout import index_of
from hapticd.plant.spring import spring_functions

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from hapticd.config.effects import Effect

_f8 = types.float64
_a = types.Array(_f8, 1, "C")

_DELAY = index_of("delay_s")
_TRANSPORT_DELAY = index_of("transport_delay.t_d")
_LAG = index_of("amplifier_lag.f_a")
_LAG_DAMPING = index_of("amplifier_lag.delta")
_LIMIT = index_of("current_saturation.i_max")
_GRID = index_of("dac_quantization.q")
_on_grid = effect_term(dac_quantization.on_grid)
_saturate = effect_term(current_saturation.saturate)


def largest_current(effects: Iterable[Effect]) -> float:
    """Largest current of the amplifier with a model's effects, A; infinite if none limits it."""
    limits = [
        float((effect.model_extra or {})["i_max"])
        for effect in effects
        if effect.name == current_saturation.EFFECT.slug
    ]
    return min(limits, default=math.inf)


@njit(_f8(_a, _f8), counted=False, inline=True)
def delivered(p: NDArray[Any], command: float) -> float:
    """Return the amplifier's set point for a command that has arrived: quantised, then limited."""
    return _saturate(_on_grid(command, p[_GRID]), p[_LIMIT])


@njit(types.UniTuple(_f8, 3)(_a, _f8, _f8, _f8, _f8), counted=False)
def lagged(p: NDArray[Any], current: float, rate: float, aim: float, span: float) -> tuple[float, float, float]:
    """Move the current loop exactly through a time of constant set point.

    Args:
        p: device vector.
        current: motor current [A].
        rate: its derivative [A/s].
        aim: set point [A].
        span: duration [s].

    Returns:
        Current and derivative after `span`, and the current's integral over it [A s].
    """
    natural = 2.0 * math.pi * p[_LAG]
    damping = p[_LAG_DAMPING]
    end_rate, s, c = spring_functions(span, damping * natural, natural * natural)
    pull = natural * natural * (aim - current)
    change = rate * s + pull * c
    new_rate = rate * end_rate + pull * s
    charge = aim * span - ((new_rate - rate) / natural + 2.0 * damping * change) / natural
    return current + change, new_rate, charge


@njit(types.void(_a, _a, _a, types.Array(types.uint8, 1, "C"), types.int64, types.Array(_f8, 2, "C")), counted=False)
def electrical(
    p: NDArray[Any],
    time_s: NDArray[Any],
    current: NDArray[Any],
    lost: NDArray[Any],
    substeps: int,
    out: NDArray[Any],
) -> None:
    """Find the motor current of a whole record, as its mean over each substep.

    Commands switch the current at their time plus the delay, wherever that falls inside a substep; the current loop is
    exact. Before the first command takes effect, the current is its steady state.

    Args:
        p: device vector, shape (SIZE,).
        time_s: times of the commands [s], shape (n,), strictly rising; row k covers [t_k, t_(k+1)), the last one as long
            as the one before.
        current: commands [A], shape (n,).
        lost: 1 where the command did not arrive and the previous one stays, shape (n,).
        substeps: equal parts of each row.
        out: mean current [A], shape (n, substeps).
    """
    count = len(time_s)
    delay = p[_DELAY] + p[_TRANSPORT_DELAY]
    has_lag = p[_LAG] < math.inf
    command = current[0]
    aim = delivered(p, command)
    motor, rate = aim, 0.0
    following = 0
    for k in range(count):
        begin = time_s[k]
        if k + 1 < count:
            h = (time_s[k + 1] - begin) / substeps
        elif k > 0:
            h = (begin - time_s[k - 1]) / substeps
        else:
            h = 0.0
        for j in range(substeps):
            now = begin + j * h
            end = begin + (j + 1) * h
            charge = 0.0
            whole = True
            while following < count and time_s[following] + delay < end:
                due = time_s[following] + delay
                if due > now:
                    whole = False
                    if has_lag:
                        motor, rate, part = lagged(p, motor, rate, aim, due - now)
                        charge += part
                    else:
                        charge += aim * (due - now)
                    now = due
                if lost[following] == 0:
                    command = current[following]
                aim = delivered(p, command)
                following += 1
            if has_lag:
                motor, rate, part = lagged(p, motor, rate, aim, end - now)
                out[k, j] = (charge + part) / h if h > 0.0 else motor
            elif whole:
                out[k, j] = aim
            else:
                out[k, j] = (charge + aim * (end - now)) / h
