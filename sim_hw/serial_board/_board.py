"""The board's behaviour, compiled: output, watchdog, latched states, and the replies to the four messages."""

from __future__ import annotations

from numba import types

from hapticd.jit import njit
from hapticd.plant import kernel
from sim_hw import layout as w
from sim_hw import log
from sim_hw._clock import monotonic_ns
from sim_hw._motion import end_sample, log_row, move_to, note_enabled, set_current, take_counts
from sim_hw.layout import I64, SIM, Sim
from sim_hw.serial_board import layout as b
from sim_hw.serial_board._sending import send
from sim_hw.serial_board.layout import LINE, Line, fault_bit

_NS_PER_MS = 1_000_000
_HELLO_REPLY, _CONFIGURE_REPLY, _SAMPLE_REPLY, _INPUTS_REPLY = 0x81, 0x82, 0x83, 0x84


@njit((SIM, LINE, I64, I64, I64), inline=True, counted=False)
def _put(sim: Sim, line: Line, offset: int, size: int, value: int) -> None:
    for n in range(size):
        line.reply[offset + n] = (value >> (8 * n)) & 0xFF


@njit((SIM, I64, I64), counted=False)
def disable(sim: Sim, ns: int, cause: int) -> None:
    """Switch the output off and to mid-scale at an instant; ``cause`` is one of the OFF_* words."""
    set_current(sim, ns, 0.0)
    sim.s[b.WATCHDOG_DUE_NS] = w.FAR_NS
    if sim.s[b.STATUS] & b.ENABLED:
        sim.s[b.STATUS] &= ~b.ENABLED
        log_row(sim, ns, log.DISABLE, cause, sim.s[b.STATUS])


@njit((SIM, I64), counted=False)
def trip_watchdog(sim: Sim, ns: int) -> None:
    """Trip the watchdog at this instant: latched, output off."""
    move_to(sim, ns)
    sim.s[b.STATUS] |= b.WATCHDOG
    log_row(sim, ns, log.WATCHDOG, sim.s[b.WATCHDOG_NS] // _NS_PER_MS, sim.s[b.COMMAND_SEQ])
    disable(sim, ns, b.OFF_WATCHDOG)


@njit((SIM, I64, I64, I64), counted=False)
def latch_fault(sim: Sim, ns: int, which: int, until_ns: int) -> None:
    """Latch a fault of the board, whose cause lasts until ``until_ns``.

    Args:
        which: 0 ENCODER_FAULT, 1 AMPLIFIER_FAULT, 2 EXTERNAL_STOP.
    """
    sim.s[b.CAUSE_UNTIL_NS + which] = until_ns
    sim.s[b.STATUS] |= fault_bit(which)
    disable(sim, ns, b.OFF_FAULT)


@njit((SIM, I64), counted=False)
def let_go(sim: Sim, ns: int) -> None:
    """Open the enable input at this instant."""
    sim.s[b.RELEASED] = 1
    if sim.s[b.WHILE_HELD] == 1:
        disable(sim, ns, b.OFF_RELEASED)


@njit((SIM, I64, I64), counted=False)
def reboot(sim: Sim, ns: int, until_ns: int) -> None:
    """Reset the processor: output off, its state and all pending bytes are lost."""
    disable(sim, ns, b.OFF_REBOOT)
    log_row(sim, ns, log.REBOOT, 0, 0)
    sim.s[b.RESET_UNTIL_NS] = until_ns
    sim.s[b.RAW_LENGTH] = 0
    sim.held[:, w.HELD_DUE_NS] = 0


@njit((SIM, I64), counted=False)
def power_up(sim: Sim, ns: int) -> None:
    """Start the processor after a reset, unconfigured, with its counter at zero."""
    sim.s[b.RESET_UNTIL_NS] = w.FAR_NS
    sim.s[b.POWER_UP_NS] = ns
    sim.s[b.STATUS] = b.UNCONFIGURED
    for which in range(3):
        if sim.s[b.CAUSE_UNTIL_NS + which] > ns:
            sim.s[b.STATUS] |= fault_bit(which)
    sim.s[b.WATCHDOG_NS] = b.WATCHDOG_POWER_UP_MS * _NS_PER_MS
    sim.s[b.COMMAND_SEQ] = 0
    sim.s[b.RELEASED] = 1
    sim.s[b.WHILE_HELD] = 0
    move_to(sim, ns)
    sim.s[w.COUNTS_OFFSET] = -kernel.plant_counts(sim.f, sim.i)
    log_row(sim, ns, log.REBOOT, 1, 0)


@njit((SIM, LINE, I64), counted=False)
def _hello(sim: Sim, line: Line, ns: int) -> None:
    disable(sim, ns, b.OFF_HELLO)
    _put(sim, line, 0, 1, _HELLO_REPLY)
    _put(sim, line, 1, 1, sim.s[b.VERSION])
    line.reply[2] = line.payload[2]
    line.reply[3] = line.payload[3]
    _put(sim, line, 4, 1, sim.s[b.DAC_BITS])
    _put(sim, line, 5, 4, sim.s[b.FULL_SCALE_UA])
    _put(sim, line, 9, 1, sim.s[b.COUNTER_BITS])
    _put(sim, line, 10, 2, b.WATCHDOG_MIN_MS)
    _put(sim, line, 12, 2, b.WATCHDOG_MAX_MS)
    _put(sim, line, 14, 4, b.SERIAL_NUMBER)
    _put(sim, line, 18, 2, b.FIRMWARE)
    send(sim, line, 20, ns)
    log_row(sim, ns, log.STATE, sim.s[b.STATUS], b.SAID_HELLO)


@njit((SIM, LINE, I64), counted=False)
def _configure(sim: Sim, line: Line, ns: int) -> None:
    wanted = int(line.payload[1]) | (int(line.payload[2]) << 8)
    if sim.s[b.STATUS] & b.ENABLED or not b.WATCHDOG_MIN_MS <= wanted <= b.WATCHDOG_MAX_MS:
        wanted = 0
    else:
        sim.s[b.WATCHDOG_NS] = wanted * _NS_PER_MS
        sim.s[b.STATUS] &= ~b.UNCONFIGURED
    _put(sim, line, 0, 1, _CONFIGURE_REPLY)
    _put(sim, line, 1, 2, wanted)
    send(sim, line, 3, ns)
    log_row(sim, ns, log.STATE, sim.s[b.STATUS], b.CONFIGURED)


@njit((SIM, LINE, I64), counted=False)
def _sample(sim: Sim, line: Line, ns: int) -> None:
    counts = take_counts(sim, ns) & ((1 << sim.s[b.COUNTER_BITS]) - 1)
    end_sample(sim)
    inputs = line.payload[0] == 0x05
    _put(sim, line, 0, 1, _INPUTS_REPLY if inputs else _SAMPLE_REPLY)
    line.reply[1] = line.payload[1]
    _put(sim, line, 2, 4, counts)
    _put(sim, line, 6, 4, (ns - sim.s[b.POWER_UP_NS]) // 1000)
    _put(sim, line, 10, 1, sim.s[b.STATUS])
    _put(sim, line, 11, 1, sim.s[b.COMMAND_SEQ])
    _put(sim, line, 12, 1, 1 - sim.s[b.RELEASED])
    # The plant does not move while the reply is sent: the row has the sampled state.
    sent = send(sim, line, 13 if inputs else 12, ns)
    sim.s[b.STATUS] &= ~b.BAD_FRAME
    turnaround = monotonic_ns(line.timespec) - ns if sent else -1
    log_row(sim, ns, log.SAMPLE, int(line.payload[1]), turnaround)


@njit((SIM, I64), counted=False)
def _clear_faults(sim: Sim, ns: int) -> None:
    sim.s[b.STATUS] &= ~b.WATCHDOG
    for which in range(3):
        if sim.s[b.CAUSE_UNTIL_NS + which] <= ns:
            sim.s[b.STATUS] &= ~fault_bit(which)


@njit((SIM, LINE, I64), counted=False)
def _command(sim: Sim, line: Line, ns: int) -> None:
    move_to(sim, ns)
    seq = int(line.payload[1])
    code = int(line.payload[2]) | (int(line.payload[3]) << 8)
    flags = int(line.payload[4])
    enable = flags & 1
    middle = 1 << (sim.s[b.DAC_BITS] - 1)
    refused = code >= 2 * middle or flags > 3
    while_held = flags >> 1
    if enable == 1 and (sim.s[b.STATUS] & (b.LATCHED | b.UNCONFIGURED) or while_held & sim.s[b.RELEASED]):
        refused = True
    if refused:
        sim.s[b.STATUS] |= b.REJECTED
        log_row(sim, ns, log.COMMAND, code, seq | (enable << 8) | (1 << 16))
        return
    sim.s[b.STATUS] &= ~b.REJECTED
    sim.s[b.COMMAND_SEQ] = seq
    if enable == 0:
        disable(sim, ns, b.OFF_COMMAND)
        _clear_faults(sim, ns)
        sim.s[b.RELEASED] = 1 if sim.s[w.RELEASED_UNTIL_NS] > ns else 0
    else:
        sim.s[b.WHILE_HELD] = while_held
        set_current(sim, ns, (code - middle) * (sim.s[b.FULL_SCALE_UA] * 1e-6) / middle)
        sim.s[b.WATCHDOG_DUE_NS] = w.FAR_NS if sim.s[w.NO_WATCHDOG] else ns + sim.s[b.WATCHDOG_NS]
    log_row(sim, ns, log.COMMAND, code, seq | (enable << 8))
    if enable == 1 and not sim.s[b.STATUS] & b.ENABLED:
        sim.s[b.STATUS] |= b.ENABLED
        note_enabled(sim, ns)


@njit(types.boolean(SIM, LINE, I64, I64), counted=False)
def handle(sim: Sim, line: Line, length: int, ns: int) -> bool:
    """Process the payload in ``line.payload``, received at an instant; False if it is not a message."""
    kind = line.payload[0]
    if (kind == 0x03 or kind == 0x05) and length == 2:
        _sample(sim, line, ns)
    elif kind == 0x04 and length == 5:
        _command(sim, line, ns)
    elif kind == 0x01 and length == 4:
        _hello(sim, line, ns)
    elif kind == 0x02 and length == 3:
        _configure(sim, line, ns)
    else:
        return False
    return True
