"""What a forked daemon needs; imported once by the server of `tests.forked`, with all compiled code."""
# ruff: noqa: F401

import can
import pandas  # pyarrow loads it where it is installed
import pyarrow.pandas_compat
import serial
import uvicorn.lifespan.off
import uvicorn.loops.asyncio

import drivers.canopen.bring_up
import drivers.seqpacket_bus
import drivers.serial_dac
import hapticd.cli.main
import hapticd.client
import hapticd.service.foreground
