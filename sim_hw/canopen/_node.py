"""The node on the bus: NMT, boot-up, heartbeat, node guarding and life guarding (CiA 301, 7.2.8)."""

from __future__ import annotations

from hapticd.jit import njit
from sim_hw._motion import log_row
from sim_hw.canopen import _sending
from sim_hw.canopen import layout as w
from sim_hw.canopen._drive import abort_connection, enter
from sim_hw.canopen._pdo import forget, transmit_events
from sim_hw.canopen.layout import MACHINE, Machine
from sim_hw.canopen.states import NOT_READY_TO_SWITCH_ON, SWITCH_ON_DISABLED
from sim_hw.layout import I64, NO_WATCHDOG
from sim_hw.log import REBOOT

BOOT_NS = 50_000_000
"""Time from power-up to the boot-up message."""
LIFE_GUARDING = 0x8130
"""EMCY: life guard error or heartbeat error."""
_START, _STOP, _PRE_OPERATIONAL, _RESET_NODE, _RESET_COMMUNICATION = 1, 2, 128, 129, 130
_CONNECTION_ABORTED = 0x8100
_GUARD_ID = 0x700
_NS_PER_MS, _NS_PER_US = 1_000_000, 1_000


@njit((MACHINE, I64), counted=False)
def _set_nmt(m: Machine, state: int) -> None:
    if m.d[w.NMT] == w.NMT_OPERATIONAL and state != w.NMT_OPERATIONAL:
        forget(m)
    m.d[w.NMT] = state


@njit((MACHINE, I64), counted=False)
def restart_heartbeat(m: Machine, now: int) -> None:
    """Start the heartbeat of 0x1017; it replaces node guarding."""
    period = m.d[w.HEARTBEAT_TIME]
    m.d[w.TIMER + w.HEARTBEAT_TIMER] = now + period * _NS_PER_MS if period else w.NEVER
    if period:
        m.d[w.TIMER + w.GUARD_TIMER] = w.NEVER


@njit((MACHINE, I64), counted=False)
def restart_sync(m: Machine, now: int) -> None:
    """Start SYNC by 0x1005 (bit 30: produce it) and 0x1006 (CiA 301, 7.5.2.5)."""
    period = m.d[w.SYNC_PERIOD] if m.d[w.SYNC_COB_ID] >> 30 & 1 else 0
    m.d[w.TIMER + w.SYNC_TIMER] = now + period * _NS_PER_US if period else w.NEVER


@njit((MACHINE, I64), counted=False)
def produce_sync(m: Machine, now: int) -> None:
    """Send one SYNC, which the drive itself also processes (:func:`sim_hw.canopen._receiving.let_go`)."""
    _sending.send(m, _sending.OTHER, m.d[w.SYNC_COB_ID] & 0x7FF, 0, 0, now)
    m.d[w.SYNC_SENT] = 1
    restart_sync(m, now)


@njit((MACHINE, I64), counted=False)
def heartbeat(m: Machine, now: int) -> None:
    """Send one heartbeat."""
    _sending.send(m, _sending.OTHER, _GUARD_ID + m.d[w.NODE_ID], 1, m.d[w.NMT], now)
    restart_heartbeat(m, now)


@njit((MACHINE, I64), counted=False)
def answer_guard(m: Machine, now: int) -> None:
    """Reply to a node guarding request: state and toggle bit; restart life guarding (0x100C × 0x100D)."""
    if m.d[w.HEARTBEAT_TIME]:
        return
    _sending.send(m, _sending.OTHER, _GUARD_ID + m.d[w.NODE_ID], 1, m.d[w.NMT] | m.d[w.GUARD_TOGGLE], now)
    m.d[w.GUARD_TOGGLE] ^= 0x80
    life = m.d[w.GUARD_TIME] * m.d[w.LIFE_TIME_FACTOR]
    m.d[w.TIMER + w.GUARD_TIMER] = now + life * _NS_PER_MS if life and not m.sim.s[NO_WATCHDOG] else w.NEVER


@njit((MACHINE, I64), counted=False)
def life_guarding_event(m: Machine, now: int) -> None:
    """No guarding request within the life time: zero current, and the reaction of 0x1029."""
    m.d[w.TIMER + w.GUARD_TIMER] = w.NEVER
    abort_connection(m, LIFE_GUARDING, now)
    transmit_events(m, now)
    if m.d[w.ERROR_BEHAVIOUR] == 0 and m.d[w.NMT] == w.NMT_OPERATIONAL:
        _set_nmt(m, w.NMT_PRE_OPERATIONAL)
    elif m.d[w.ERROR_BEHAVIOUR] == 2:
        _set_nmt(m, w.NMT_STOPPED)


@njit((MACHINE, I64, I64, I64), counted=False)
def power_down(m: Machine, reset: int, duration: int, now: int) -> None:
    """Begin a reset or a power cycle: no current, no frames, and the boot-up message ``duration`` ns later."""
    enter(m, NOT_READY_TO_SWITCH_ON, now)
    log_row(m.sim, now, REBOOT, reset, 0)
    m.d[w.POWERED] = 0
    m.d[w.NMT] = w.NMT_BOOTING
    m.d[w.RESET] = reset
    m.d[w.PREVIOUS_CONTROL] = 0
    m.d[w.OUT_COUNT] = 0
    m.d[w.SDO_COUNT] = 0
    for timer in range(w.TIMERS):
        m.d[w.TIMER + timer] = w.NEVER
    m.d[w.TIMER + w.WAKE_TIMER] = now + duration


@njit((MACHINE, I64), counted=False)
def boot(m: Machine, now: int) -> None:
    """Boot: boot-up message, Pre-operational, Switch On Disabled (transition 1)."""
    m.d[w.TIMER + w.WAKE_TIMER] = w.NEVER
    m.d[w.POWERED] = 1
    m.d[w.GUARD_TOGGLE] = 0
    _sending.send(m, _sending.OTHER, _GUARD_ID + m.d[w.NODE_ID], 1, 0, now)
    m.d[w.NMT] = w.NMT_PRE_OPERATIONAL
    enter(m, SWITCH_ON_DISABLED, now)
    restart_heartbeat(m, now)
    restart_sync(m, now)


@njit((MACHINE, I64, I64), counted=False)
def command(m: Machine, data: int, now: int) -> None:
    """NMT command for this node or for all."""
    node = (data >> 8) & 0xFF
    if node not in (0, m.d[w.NODE_ID]):
        return
    what = data & 0xFF
    if what == _START:
        _set_nmt(m, w.NMT_OPERATIONAL)
        transmit_events(m, now)
    elif what == _STOP:
        abort_connection(m, _CONNECTION_ABORTED, now)
        _set_nmt(m, w.NMT_STOPPED)
    elif what == _PRE_OPERATIONAL:
        _set_nmt(m, w.NMT_PRE_OPERATIONAL)
    elif what == _RESET_NODE:
        power_down(m, w.RESET_NODE, BOOT_NS, now)
    elif what == _RESET_COMMUNICATION:
        power_down(m, w.RESET_COMMUNICATION, BOOT_NS, now)
