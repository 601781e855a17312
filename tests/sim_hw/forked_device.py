"""What a forked device needs; imported once by the server of `tests.forked`, with all compiled code."""

import sim_hw.canopen.command
import sim_hw.canopen.serve
import sim_hw.firmware.command
import sim_hw.firmware.device
import sim_hw.serial_board.command
import sim_hw.serial_board.service  # noqa: F401
