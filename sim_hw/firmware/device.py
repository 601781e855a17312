"""The test bench: board, port and plant, and the Python part of its service."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from hapticd.config import ConfigError, Problem
from hapticd.plant import kernel
from sim_hw import layout as w
from sim_hw import log
from sim_hw._motion import log_row, set_current
from sim_hw._plant import end_log
from sim_hw.firmware._emulator import EmulatorError
from sim_hw.firmware._layout import BOARD, FRAMED
from sim_hw.firmware._output import lose_power, show_inputs, take_outputs
from sim_hw.firmware._service import BOARD_GONE, PLUG_IN, POWER_OFF, POWER_ON, STOPPED, UNPLUG, serve
from sim_hw.serial_board import layout as b

if TYPE_CHECKING:
    from hapticd.config import Config
    from sim_hw.firmware._emulator import Board, Emulator
    from sim_hw.layout import Sim
    from sim_hw.script import Script
    from sim_hw.serial_board.port import Port


def set_up(config: Config, script: Script, plant_name: str, board: Board) -> Sim:
    """The test bench's memory with the board off.

    Args:
        config: the plant file; its converter must be that of the board.
        script: hand, start and faults. plant_name: of the plant file, for messages.

    Raises:
        ConfigError: a plant file with another converter.
    """
    amplifier = config.amplifier
    for key, found, wanted in (
        ("dac_bits", amplifier.dac_bits, board.dac_bits),
        ("dac_full_scale", amplifier.dac_full_scale, board.full_scale_A),
    ):
        if found != wanted:
            message = f"this board has {wanted:g} {'bits' if key == 'dac_bits' else 'A'}"
            raise ConfigError([Problem(plant_name, f"amplifier.{key}", str(found), message)])
    sim = b.new_board(config, script, board.dac_bits, board.full_scale_A)
    sim.s[BOARD] = -1
    sim.s[b.VERSION] = -1 if script.wrong_version is None else script.wrong_version
    sim.s[FRAMED] = int(len(script.faults) > 0)
    return sim


def run_bench(sim: Sim, emulator: Emulator, port: Port) -> None:
    """Run the test bench until ``sim.s[STOP]`` is set; then switch the board off and end the log.

    Raises:
        EmulatorError: the board ended, or does not start.
    """
    # A plain array of the mapped memory, for compiled code.
    line = b.new_line(np.frombuffer(emulator.page, np.uint32))
    sim.s[BOARD], sim.s[b.MASTER] = emulator.descriptor, port.master
    while (reason := serve(sim, line)) != STOPPED:
        now = time.monotonic_ns()
        if reason == UNPLUG:
            port.unplug()
        elif reason == PLUG_IN:
            port.plug_in()
        elif reason == POWER_OFF:
            emulator.power_off()
            lose_power(sim, line, now)
        elif reason == POWER_ON:
            sim.s[w.COUNTS_OFFSET] = -kernel.plant_counts(sim.f, sim.i)
            show_inputs(sim, line, now)
            emulator.power_on()
            sim.s[BOARD] = emulator.descriptor
            log_row(sim, time.monotonic_ns(), log.REBOOT, 1, 0)
        elif reason == BOARD_GONE:
            raise EmulatorError("the board's process has ended")
        if reason in (UNPLUG, PLUG_IN):
            sim.s[b.MASTER], sim.s[b.LINE_OPEN] = port.master, 0
    now = time.monotonic_ns()
    take_outputs(sim, line, now)
    emulator.power_off()
    set_current(sim, now, 0.0)
    end_log(sim, now)
