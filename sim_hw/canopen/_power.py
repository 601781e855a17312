"""From a target in the object dictionary to the motor current: scale, limits, I²t, slope.

In cyclic synchronous torque mode 0x6071 is in ‰ of the rated torque 0x6076 (mN m); with Copley's programmed current
(0x2300 = 1) 0x2340 is in 0.01 A. The slopes 0x6087 (‰/s) and 0x2113 (mA/s) change the demand in the drive's cycle of
62.5 µs; 0 is no slope. While the power stage is off the current is zero.
"""

from __future__ import annotations

import numpy as np

from hapticd.jit import njit
from hapticd.plant import kernel
from sim_hw._motion import set_current
from sim_hw.canopen import layout as w
from sim_hw.canopen.layout import F64, MACHINE, Machine
from sim_hw.canopen.states import OPERATION_ENABLED
from sim_hw.layout import COMMAND_A, I64

CYCLE_NS = 62_500
"""Period of the drive's own torque generator."""
_HEAT_CYCLE_NS = 1_000_000
CYCLIC_TORQUE = 10
DESIRED_PROGRAMMED_CURRENT = 1
CURRENT_UNIT = 0.01
"""A per count of the Copley current objects."""
_PERMILLE_OF_MILLI = 1e-6
_CURRENT_LIMITED = 1 << 7
"""Copley event status 0x1002: current output limited."""


@njit(F64(MACHINE), counted=False)
def amperes_per_permille(m: Machine) -> float:
    """Current for 1 ‰ of the rated torque, A."""
    return float(m.d[w.RATED_TORQUE]) * _PERMILLE_OF_MILLI / m.sim.f[kernel.TORQUE_CONSTANT]


@njit("int64(float64, int64)", counted=False)
def rounded(value: float, bits: int) -> int:
    """Nearest integer, clamped to ±(2^bits − 1)."""
    limit = float((1 << bits) - 1)
    return int(np.floor(min(max(value, -limit), limit) + 0.5))


@njit(I64(MACHINE, F64), counted=False)
def torque_permille(m: Machine, current: float) -> int:
    """A current as ‰ of the rated torque; 0 for a drive without a rated torque."""
    unit = amperes_per_permille(m)
    return rounded(current / unit, 15) if unit > 0.0 else 0


@njit(F64(MACHINE), counted=False)
def _wanted(m: Machine) -> float:
    if m.d[w.STATE] != OPERATION_ENABLED:
        return 0.0
    if m.d[w.DESIRED_STATE] == DESIRED_PROGRAMMED_CURRENT:
        return float(m.d[w.PROGRAMMED_CURRENT]) * CURRENT_UNIT
    if m.d[w.MODE_DISPLAY] == CYCLIC_TORQUE:
        limit = m.d[w.MAX_TORQUE]
        return float(min(max(m.d[w.TARGET_TORQUE], -limit), limit)) * amperes_per_permille(m)
    return 0.0


@njit(F64(MACHINE), counted=False)
def _slope(m: Machine) -> float:
    """A/s; 0 for none."""
    if m.d[w.DESIRED_STATE] == DESIRED_PROGRAMMED_CURRENT:
        return float(m.d[w.CURRENT_RAMP]) * 1e-3
    return float(m.d[w.TORQUE_SLOPE]) * amperes_per_permille(m)


@njit((MACHINE, I64), counted=False)
def _heat_up(m: Machine, now: int) -> None:
    """I²t: 0x2110 is allowed above 0x2111 for 0x2112 ms; then the continuous limit until the I²t is zero again."""
    continuous = float(m.d[w.CONTINUOUS_LIMIT]) * CURRENT_UNIT
    peak = float(m.d[w.PEAK_LIMIT]) * CURRENT_UNIT
    room = max(peak * peak - continuous * continuous, 0.0) * float(m.d[w.PEAK_TIME]) * 1e-3
    excess = m.a[w.DEMAND] * m.a[w.DEMAND] - continuous * continuous
    m.a[w.HEAT] = min(max(m.a[w.HEAT] + excess * float(now - m.d[w.HEAT_NS]) * 1e-9, 0.0), room)
    m.d[w.HEAT_NS] = now
    if excess > 0.0 and m.a[w.HEAT] == room:
        m.d[w.FOLDED] = 1
    elif m.a[w.HEAT] == 0.0:
        m.d[w.FOLDED] = 0


@njit((MACHINE, F64, I64), counted=False)
def _demand(m: Machine, current: float, now: int) -> None:
    """Set the current loop's set point."""
    if current != m.a[w.DEMAND]:
        _heat_up(m, now)
        m.a[w.DEMAND] = current
        set_current(m.sim, now, current)
        if abs(current) > float(m.d[w.CONTINUOUS_LIMIT]) * CURRENT_UNIT and m.d[w.TIMER + w.HEAT_TIMER] == w.NEVER:
            m.d[w.TIMER + w.HEAT_TIMER] = now + _HEAT_CYCLE_NS
    m.sim.sf[COMMAND_A] = m.a[w.TARGET]
    m.d[w.TORQUE_DEMAND] = torque_permille(m, current)


@njit((MACHINE, I64), counted=False)
def retarget(m: Machine, now: int) -> None:
    """Apply the present target: at once without a slope, else from the drive's next cycle on."""
    limit = float(m.d[w.CONTINUOUS_LIMIT] if m.d[w.FOLDED] == 1 else m.d[w.PEAK_LIMIT]) * CURRENT_UNIT
    wanted = _wanted(m)
    m.a[w.TARGET] = min(max(wanted, -limit), limit)
    m.d[w.EVENT_STATUS] &= ~_CURRENT_LIMITED
    if m.a[w.TARGET] != wanted:
        m.d[w.EVENT_STATUS] |= _CURRENT_LIMITED
    if m.d[w.STATE] != OPERATION_ENABLED or _slope(m) == 0.0 or m.a[w.TARGET] == m.a[w.DEMAND]:
        m.d[w.TIMER + w.RAMP_TIMER] = w.NEVER
        _demand(m, m.a[w.TARGET], now)
    elif m.d[w.TIMER + w.RAMP_TIMER] == w.NEVER:
        m.d[w.TIMER + w.RAMP_TIMER] = now + CYCLE_NS


@njit((MACHINE, I64), counted=False)
def ramp(m: Machine, now: int) -> None:
    """One cycle of the drive's torque generator."""
    step = _slope(m) * CYCLE_NS * 1e-9
    away = m.a[w.TARGET] - m.a[w.DEMAND]
    if abs(away) <= step:
        m.d[w.TIMER + w.RAMP_TIMER] = w.NEVER
        _demand(m, m.a[w.TARGET], now)
    else:
        m.d[w.TIMER + w.RAMP_TIMER] = now + CYCLE_NS
        _demand(m, m.a[w.DEMAND] + (step if away > 0.0 else -step), now)


@njit((MACHINE, I64), counted=False)
def watch_heat(m: Machine, now: int) -> None:
    """One cycle of the I²t supervision, until the current is no longer above the continuous limit."""
    _heat_up(m, now)
    hot = abs(m.a[w.DEMAND]) > float(m.d[w.CONTINUOUS_LIMIT]) * CURRENT_UNIT or m.d[w.FOLDED] == 1
    m.d[w.TIMER + w.HEAT_TIMER] = now + _HEAT_CYCLE_NS if hot else w.NEVER
    retarget(m, now)
