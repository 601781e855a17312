"""The devices that the protocol's suite runs against: sim_hw's board, and the firmware's boards."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_hw.log import COMMAND, DISABLE, ENABLE
from tests.firmware.builds import require
from tests.sim_hw.boards import Board, running_board
from tests.sim_hw.host import Host

SIM_HW = "sim_hw"
DEVICES = (SIM_HW, "host", "mps2-an385", pytest.param("avr-uno", marks=pytest.mark.avr))
PLANTS = {"avr-uno": "amplifier: {dac_bits: 12}"}


@dataclass(frozen=True)
class Device:
    """One of them, and how its log tells of time."""

    name: str

    @contextlib.contextmanager
    def running(self, folder: Path, script: str = "") -> Iterator[Board]:
        """The device as a process, on a link in ``folder``."""
        device = ("serial",) if self.name == SIM_HW else ("firmware", "--board", self.name)
        with running_board(folder, script, PLANTS.get(self.name, ""), device=device) as board:
            yield board

    @contextlib.contextmanager
    def host(self, folder: Path, script: str = "") -> Iterator[tuple[Board, Host]]:
        """The device and a host on its port."""
        with self.running(folder, script) as board:
            host = Host(board.link)
            try:
                yield board, host
            finally:
                with contextlib.suppress(OSError):
                    host.close()

    def off_after_ms(self, log: NDArray[Any]) -> float:
        """Time from the last output of a code while enabled to the first switching off after it, by the board's clock."""
        first_off = int(np.flatnonzero(log["event"] == DISABLE)[0])
        accepted = np.isin(log["event"][:first_off], (COMMAND, ENABLE)) & (log["detail"][:first_off] >> 16 != 1)
        if self.name == SIM_HW:
            return float(log["time_ns"][first_off] - log["time_ns"][:first_off][accepted][-1]) * 1e-6
        told = log["event"][:first_off] == COMMAND  # ENABLE comes with the COMMAND before it
        return float(log["detail"][first_off] - log["detail"][:first_off][told][-1]) * 1e-3


def currents(log: NDArray[Any]) -> list[float]:
    """The commanded currents, A, one after the other, without repeats."""
    command = log["command_A"]
    return [float(value) for value in command[np.concatenate(([True], np.diff(command) != 0.0))]]


def get(name: str) -> Device:
    """A device that can be run here; skips the test where its emulator is missing."""
    if name != SIM_HW:
        require(name)
    return Device(name)
