"""What a forked device needs; imported once by the server of `tests.forked`, with all compiled code."""
# ruff: noqa: F401

import can
import canopen
import pandas  # pyarrow loads it where it is installed
import pyarrow.pandas_compat

import sim_hw.__main__
import sim_hw.canopen.command
import sim_hw.canopen.device
import sim_hw.canopen.serve
import sim_hw.canopen.transport
import sim_hw.firmware.command
import sim_hw.firmware.device
import sim_hw.script
import sim_hw.serial_board.command
import sim_hw.serial_board.device
import sim_hw.serial_board.port
import sim_hw.serial_board.service
