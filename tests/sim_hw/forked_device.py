"""What a forked device runs; imported by the server once, with all compiled code."""

import os
import sys
from multiprocessing.connection import Connection

import sim_hw.canopen.command
import sim_hw.canopen.serve
import sim_hw.firmware.command
import sim_hw.firmware.device
import sim_hw.serial_board.command
import sim_hw.serial_board.service  # noqa: F401
from sim_hw.__main__ import main


def run(arguments: list[str], cwd: str, out: Connection, err: Connection) -> None:
    """The device's whole life; ends the process with the command's exit code."""
    os.chdir(cwd)
    for number, pipe in ((1, out), (2, err)):
        os.dup2(pipe.fileno(), number)
        pipe.close()
    sys.exit(main(arguments))
