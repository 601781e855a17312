"""The board: its data from a plant file, its port, and the Python part of its service."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from hapticd.config import ConfigError, Problem
from sim_hw import layout as w
from sim_hw import log
from sim_hw._motion import log_row
from sim_hw._plant import end_log
from sim_hw.serial_board import layout as b
from sim_hw.serial_board._board import disable
from sim_hw.serial_board.service import STOPPED, UNPLUG, serve

if TYPE_CHECKING:
    from hapticd.config import Config
    from sim_hw.layout import Sim
    from sim_hw.script import Script
    from sim_hw.serial_board.port import Port

PROTOCOL_VERSION = 1
_BITS_PER_BYTE = 10  # start, eight data bits, stop


def switch_on(config: Config, script: Script, plant_name: str, *, line_baud: int, counter_bits: int) -> Sim:
    """A board's memory just after power-up.

    Args:
        config: the plant file; its ``amplifier.dac_bits`` and ``dac_full_scale`` are the board's converter.
        script: hand, start and faults.
        plant_name: of the plant file, for messages.
        line_baud: baud of the emulated line; 0: no transmission time.
        counter_bits: width of the encoder counter, 16 … 32.

    Raises:
        ConfigError: a plant file with a converter that the protocol does not allow.
    """
    amplifier = config.amplifier
    bits, full_scale_A = amplifier.dac_bits or 0, amplifier.dac_full_scale or 0.0
    if not 8 <= bits <= 16:
        message = "the board's converter has 8 to 16 bits"
        raise ConfigError([Problem(plant_name, "amplifier.dac_bits", str(amplifier.dac_bits), message)])
    if not 0 < round(full_scale_A * 1e6) < 2**32:
        message = "the board's converter has a full scale of 1 µA to 4294 A"
        raise ConfigError([Problem(plant_name, "amplifier.dac_full_scale", str(amplifier.dac_full_scale), message)])
    sim = b.new_board(config, script, bits, full_scale_A)
    s = sim.s
    s[b.STATUS] = b.UNCONFIGURED
    s[b.RELEASED] = 1
    s[b.WATCHDOG_NS] = b.WATCHDOG_POWER_UP_MS * 1_000_000
    s[b.COUNTER_BITS] = counter_bits
    s[b.VERSION] = PROTOCOL_VERSION if script.wrong_version is None else script.wrong_version
    s[b.POWER_UP_NS] = s[w.START_NS]
    s[b.BYTE_NS] = round(_BITS_PER_BYTE * 1e9 / line_baud) if line_baud else 0
    return sim


def run_board(sim: Sim, port: Port) -> None:
    """Run the board until ``sim.s[STOP]`` is set; then switch the output off and end the log."""
    line = b.new_line(np.zeros(0, np.uint32))
    sim.s[b.MASTER] = port.master
    while (reason := serve(sim, line)) != STOPPED:
        if reason == UNPLUG:
            port.unplug()
        else:
            port.plug_in()
        sim.s[b.MASTER] = port.master
        sim.s[b.LINE_OPEN] = 0
        detail = b.UNPLUGGED if reason == UNPLUG else b.PLUGGED
        log_row(sim, time.monotonic_ns(), log.STATE, int(sim.s[b.STATUS]), detail)
    now = time.monotonic_ns()
    disable(sim, now, b.OFF_COMMAND)
    end_log(sim, now)
