"""The drive's own actions, each at its due instant, even if the process is late."""

from __future__ import annotations

from hapticd.jit import njit
from sim_hw import kinds
from sim_hw import layout as common
from sim_hw._faults import begin_fault, next_event_ns, next_fault
from sim_hw._motion import move_to
from sim_hw.canopen import _node, _pdo, _power, _sending
from sim_hw.canopen import layout as w
from sim_hw.canopen._drive import abort_connection, enter, fail, refresh_status
from sim_hw.canopen.layout import MACHINE, Machine
from sim_hw.canopen.states import FAULT, OPERATION_ENABLED, SWITCH_ON_DISABLED
from sim_hw.layout import I64

_SDO_CLIENT = 0x600
_RPDO_TIMEOUT = 0x8250
"""EMCY: RPDO time-out."""


@njit((MACHINE, I64), counted=False)
def _foreign_write(m: Machine, row: int) -> None:
    """An expedited SDO write of no client on this socket; all clients receive its reply."""
    if m.d[w.SDO_COUNT] < w.QUEUE:
        fault = m.sim.faults[row]
        command = 0x23 | (4 - fault[common.FAULT_SIZE]) << 2
        about = (fault[common.FAULT_OBJECT] & 0xFFFF) << 8 | (fault[common.FAULT_OBJECT] >> 16) << 24
        m.sdo[m.d[w.SDO_COUNT], 0] = _sending.header(_SDO_CLIENT + m.d[w.NODE_ID], 8)
        m.sdo[m.d[w.SDO_COUNT], 1] = command | about | fault[common.FAULT_VALUE] << 32
        m.d[w.SDO_COUNT] += 1


@njit((MACHINE,), counted=False)
def _inject(m: Machine) -> None:
    kind, row, now, until = begin_fault(m.sim)
    if kind == kinds.EMERGENCY:
        fail(m, m.sim.faults[row, common.FAULT_CODE], now)
    elif kind == kinds.LEAVE_OPERATION_ENABLED:
        if m.d[w.STATE] == OPERATION_ENABLED:
            enter(m, SWITCH_ON_DISABLED, now)
    elif kind == kinds.REBOOT:
        _node.power_down(m, w.RESET_NODE, until - now, now)
    elif kind == kinds.BUS_OFF:
        _sending.put(m, _sending.header(_sending.ERROR | _sending.BUS_OFF, 8), 0)
        m.d[w.BUS_OFF_UNTIL_NS] = until
    elif kind == kinds.UNPLUG:
        m.d[w.UNPLUGGED_UNTIL_NS] = until
    elif kind == kinds.MEASURED_CURRENT:
        m.d[w.MEASURED_UNTIL_NS] = until
        m.d[w.MEASURED_PPM] = m.sim.faults[row, common.FAULT_FACTOR_PPM]
        m.d[w.MEASURED_UA] = m.sim.faults[row, common.FAULT_CURRENT_UA]
    elif kind == kinds.SECOND_NODE:
        m.d[w.SECOND_LEFT] = m.sim.faults[row, common.FAULT_COUNT]
        m.d[w.SECOND_COUNTS] = m.sim.faults[row, common.FAULT_COUNTS]
    elif kind == kinds.FOREIGN_SDO:
        _foreign_write(m, row)


@njit((MACHINE, I64, I64), counted=False)
def _expire(m: Machine, timer: int, now: int) -> None:
    m.d[w.TIMER + timer] = w.NEVER
    if timer == w.RAMP_TIMER:
        _power.ramp(m, now)
    elif timer == w.HEAT_TIMER:
        _power.watch_heat(m, now)
    elif timer == w.GUARD_TIMER:
        _node.life_guarding_event(m, now)
    elif timer == w.HEARTBEAT_TIMER:
        _node.heartbeat(m, now)
    elif timer == w.QUICK_STOP_TIMER:
        enter(m, SWITCH_ON_DISABLED, now)  # transition 12
    elif timer == w.REACTION_TIMER:
        enter(m, FAULT, now)  # transition 14
    elif timer == w.WAKE_TIMER:
        _node.boot(m, now)
    elif timer == w.SYNC_TIMER:
        _node.produce_sync(m, now)
    elif timer >= w.RPDO_TIMER:
        abort_connection(m, _RPDO_TIMEOUT, now)
    else:
        _pdo.refresh_inputs(m, now)
        _pdo.transmit(m, timer - w.TPDO_TIMER, now)
    refresh_status(m)
    _pdo.transmit_events(m, now)


@njit((MACHINE, I64), counted=False)
def advance(m: Machine, now: int) -> None:
    """Advance the drive to an instant: its timers, the script's faults, the plant, in the order of their instants."""
    while m.d[w.RESET] == w.NO_RESET:
        timer = 0
        for other in range(1, w.TIMERS):
            if m.d[w.TIMER + other] < m.d[w.TIMER + timer]:
                timer = other
        due = m.d[w.TIMER + timer]
        _, fault_due = next_fault(m.sim)
        if min(due, fault_due) > now:
            break
        if fault_due <= due:
            move_to(m.sim, fault_due)
            _inject(m)
            _pdo.transmit_events(m, fault_due)
        else:
            move_to(m.sim, due)
            _expire(m, timer, due)
    move_to(m.sim, now)


@njit(I64(MACHINE), counted=False)
def next_wake(m: Machine) -> int:
    """Instant of the next externally visible event, ns; FAR_NS if there is none."""
    wake = next_event_ns(m.sim)
    for timer in range(w.LAZY_TIMERS, w.TIMERS):
        wake = min(wake, m.d[w.TIMER + timer])
    return wake
