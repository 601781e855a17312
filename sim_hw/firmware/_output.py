"""The plant at the board, compiled: its outputs move the plant, the plant moves its counter."""

from __future__ import annotations

from hapticd.jit import fence_acquire, njit
from sim_hw import layout as w
from sim_hw import log
from sim_hw._motion import log_row, note_enabled, set_current, take_counts
from sim_hw.firmware import _page as p
from sim_hw.firmware._layout import BOARD, BOARD_LENGTH, READ
from sim_hw.layout import I64, SIM, Sim
from sim_hw.serial_board import layout as b
from sim_hw.serial_board.layout import LINE, Line, fault_bit


@njit((SIM, I64, I64, I64, I64), counted=False)
def put_out(sim: Sim, ns: int, code: int, enabled: int, time_us: int) -> None:
    """Apply the board's DAC and enable line from this instant on; each change has a row.

    Args:
        time_us: the board's clock at that output, for the row's ``detail``.
    """
    middle = 1 << (sim.s[b.DAC_BITS] - 1)
    current = (code - middle) * (sim.s[b.FULL_SCALE_UA] * 1e-6) / middle if enabled == 1 else 0.0
    set_current(sim, ns, current)
    if enabled == sim.s[b.STATUS]:
        log_row(sim, ns, log.COMMAND, code, time_us)
    elif enabled == 1:
        sim.s[b.STATUS] = b.ENABLED
        note_enabled(sim, ns)
    else:
        sim.s[b.STATUS] = 0
        log_row(sim, ns, log.DISABLE, code, time_us)


@njit((SIM, LINE, I64), counted=False)
def take_outputs(sim: Sim, line: Line, ns: int) -> None:
    """Process all outputs of the board since the last call, in order."""
    written = line.page[p.WRITTEN]
    fence_acquire()
    while sim.s[READ] != written:
        first = p.OUTPUTS + (sim.s[READ] % p.RING) * p.OUTPUT_WORDS
        code, enabled = line.page[first + p.CODE], line.page[first + p.ENABLED]
        put_out(sim, ns, code, enabled, line.page[first + p.TIME_US])
        sim.s[READ] = (sim.s[READ] + 1) & 0xFFFFFFFF


@njit((SIM, LINE, I64), counted=False)
def show_inputs(sim: Sim, line: Line, ns: int) -> None:
    """Set encoder and fault inputs for an instant."""
    line.page[p.COUNT] = take_counts(sim, ns) & 0xFFFFFFFF
    causes = 1 if sim.s[w.RELEASED_UNTIL_NS] <= ns else 0  # the enable input is closed
    for which in range(3):
        if sim.s[b.CAUSE_UNTIL_NS + which] > ns:
            causes |= fault_bit(which)
    line.page[p.CAUSES] = causes


@njit((SIM, LINE, I64), counted=False)
def lose_power(sim: Sim, line: Line, ns: int) -> None:
    """Switch the board off: its pull resistors switch the output off, and pending bytes are lost."""
    middle = 1 << (sim.s[b.DAC_BITS] - 1)
    take_outputs(sim, line, ns)
    if sim.s[b.STATUS] == b.ENABLED:
        put_out(sim, ns, middle, 0, 0)
    log_row(sim, ns, log.REBOOT, 0, 0)
    sim.s[BOARD] = -1
    sim.s[b.RAW_LENGTH] = 0
    sim.s[BOARD_LENGTH] = 0
    sim.held[:, w.HELD_DUE_NS] = 0
