"""The drive in CiA 402: entering a state, faults and emergencies, controlwords."""

from __future__ import annotations

from hapticd.jit import njit
from sim_hw._motion import log_row, note_enabled
from sim_hw.canopen import _sending
from sim_hw.canopen import layout as w
from sim_hw.canopen._power import CYCLIC_TORQUE, retarget
from sim_hw.canopen.layout import BOOL, MACHINE, Machine
from sim_hw.canopen.states import (
    FAULT,
    FAULT_REACTION_ACTIVE,
    NOT_READY_TO_SWITCH_ON,
    OPERATION_ENABLED,
    QUICK_STOP_ACTIVE,
    SWITCH_ON_DISABLED,
    next_state,
    state_bits,
)
from sim_hw.layout import I64
from sim_hw.log import DISABLE, EMCY, STATE

QUICK_STOP_NS = 10_000_000
"""Duration of a quick stop with option codes 1…4: a torque drive has no speed ramp, only zero current."""
REACTION_NS = 1_000_000
"""Duration of the fault reaction."""
_VOLTAGE_ENABLED, _REMOTE, _LIMIT_ACTIVE, _FOLLOWS = 1 << 4, 1 << 9, 1 << 11, 1 << 12
# Copley event status, 0x1002.
_CURRENT_LIMITED, _DISABLED_BY_SOFTWARE, _OUTPUTS_DISABLED, _FAULT_LATCHED = 1 << 7, 1 << 12, 1 << 15, 1 << 22
_QUICK_STOP_STAYS = 5
_EMCY_INVALID = 1 << 31
# By the class of an error code, 0x0 to 0xF.
_REGISTER_BIT = (0, 0, 1 << 1, 1 << 2, 1 << 3, 1 << 5, 1 << 5, 1 << 5, 1 << 4) + 7 * (0,)
_LATCHED_BIT = (1, 1, 1 << 2, 1 << 5, 1 << 3, 1, 1, 1 << 7, 1 << 12) + 7 * (1,)
"""Short circuit (2), over voltage (3), drive too hot (4), feedback (7), command input lost (8), any other."""


@njit((MACHINE,), counted=False)
def refresh_status(m: Machine) -> None:
    """Set statusword and Copley event status from the state."""
    status = state_bits(m.d[w.STATE]) | _VOLTAGE_ENABLED | _REMOTE
    events = m.d[w.EVENT_STATUS] & _CURRENT_LIMITED
    if events:
        status |= _LIMIT_ACTIVE
    if m.d[w.STATE] == OPERATION_ENABLED:
        if m.d[w.MODE_DISPLAY] == CYCLIC_TORQUE:
            status |= _FOLLOWS
    else:
        events |= _OUTPUTS_DISABLED | _DISABLED_BY_SOFTWARE
    if m.d[w.LATCHED_FAULTS]:
        events |= _FAULT_LATCHED
    m.d[w.STATUSWORD] = status
    m.d[w.EVENT_STATUS] = events


@njit((MACHINE, I64, I64), counted=False)
def enter(m: Machine, state: int, now: int) -> None:
    """Change to a state: power stage, timers, log. The present state changes nothing."""
    old = m.d[w.STATE]
    if state == old:
        return
    m.d[w.STATE] = state
    log_row(m.sim, now, STATE, state, old)
    m.d[w.TIMER + w.QUICK_STOP_TIMER] = w.NEVER
    m.d[w.TIMER + w.REACTION_TIMER] = w.NEVER
    if old == OPERATION_ENABLED:
        log_row(m.sim, now, DISABLE, state, 0)
    elif state == OPERATION_ENABLED:
        note_enabled(m.sim, now)
    if state == QUICK_STOP_ACTIVE and m.d[w.QUICK_STOP_OPTION] < _QUICK_STOP_STAYS:
        m.d[w.TIMER + w.QUICK_STOP_TIMER] = now + QUICK_STOP_NS
    if state == FAULT_REACTION_ACTIVE:
        m.d[w.TIMER + w.REACTION_TIMER] = now + REACTION_NS
    retarget(m, now)
    refresh_status(m)


@njit("int64(int64)", counted=False)
def register_bits(code: int) -> int:
    """Error register 0x1001 for an error code: the generic bit, and the bit of the code's class (CiA 301, 7.5.2.2)."""
    return 1 | _REGISTER_BIT[code >> 12]


@njit("int64(int64)", counted=False)
def latched_bits(code: int) -> int:
    """Copley latched fault register 0x2183 for an error code: its class's bit."""
    return _LATCHED_BIT[code >> 12]


@njit((MACHINE, I64, I64), counted=False)
def emergency(m: Machine, code: int, now: int) -> None:
    """Send EMCY: error code, error register, and as the vendor's part the latched faults. Code 0: no error."""
    if code:
        for field in range(w.ERROR_FIELDS - 1, 0, -1):
            m.d[w.ERROR_COUNT + field + 1] = m.d[w.ERROR_COUNT + field]
        m.d[w.ERROR_COUNT + 1] = code
        m.d[w.ERROR_COUNT] = min(m.d[w.ERROR_COUNT] + 1, w.ERROR_FIELDS)
    log_row(m.sim, now, EMCY, code, m.d[w.ERROR_REGISTER])
    if m.d[w.NMT] in (w.NMT_OPERATIONAL, w.NMT_PRE_OPERATIONAL) and not m.d[w.EMCY_COB_ID] & _EMCY_INVALID:
        data = code | m.d[w.ERROR_REGISTER] << 16 | m.d[w.LATCHED_FAULTS] << 24
        _sending.send(m, _sending.OTHER, m.d[w.EMCY_COB_ID] & 0x7FF, 8, data, now)


@njit((MACHINE, I64, I64), counted=False)
def fail(m: Machine, code: int, now: int) -> None:
    """Device fault: zero current, EMCY, Fault Reaction Active and from there Fault (transitions 13 and 14)."""
    m.d[w.ERROR_CODE] = code
    m.d[w.ERROR_REGISTER] |= register_bits(code)
    m.d[w.LATCHED_FAULTS] |= latched_bits(code)
    if m.d[w.STATE] not in (FAULT, FAULT_REACTION_ACTIVE, NOT_READY_TO_SWITCH_ON):
        enter(m, FAULT_REACTION_ACTIVE, now)
    emergency(m, code, now)


@njit((MACHINE, I64, I64), counted=False)
def abort_connection(m: Machine, code: int, now: int) -> None:
    """The master is lost: the reaction of 0x6007 in Operation Enabled, and always EMCY."""
    option = m.d[w.ABORT_OPTION]
    if m.d[w.STATE] == OPERATION_ENABLED and option == 1:
        fail(m, code, now)
        return
    if m.d[w.STATE] == OPERATION_ENABLED and option == 2:
        enter(m, SWITCH_ON_DISABLED, now)
    elif m.d[w.STATE] == OPERATION_ENABLED and option == 3:
        enter(m, QUICK_STOP_ACTIVE, now)
    m.d[w.ERROR_REGISTER] |= register_bits(code)
    emergency(m, code, now)


@njit((MACHINE, BOOL, I64), counted=False)
def take_up(m: Machine, controlled: bool, now: int) -> None:
    """Apply objects that a master may have written: mode, targets, limits, and the controlword if `controlled`."""
    mode = m.d[w.MODE]
    if mode == 0 or (mode > 0 and m.d[w.SUPPORTED_MODES] >> (mode - 1) & 1):
        m.d[w.MODE_DISPLAY] = mode
    if controlled:
        control, previous = m.d[w.CONTROLWORD], m.d[w.PREVIOUS_CONTROL]
        m.d[w.PREVIOUS_CONTROL] = control
        was_fault = m.d[w.STATE] == FAULT
        enter(m, next_state(m.d[w.STATE], control, previous, m.d[w.QUICK_STOP_OPTION]), now)
        if was_fault and m.d[w.STATE] != FAULT:
            m.d[w.ERROR_CODE] = 0
            m.d[w.ERROR_REGISTER] = 0
            m.d[w.LATCHED_FAULTS] = 0
            emergency(m, 0, now)
    retarget(m, now)
    refresh_status(m)
