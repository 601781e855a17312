"""The daemon stands still: the DAC's word is at mid-scale in time, by the log of what the board put out."""

import signal
import time
from pathlib import Path

import numpy as np
import pytest

from hapticd.config import parse_config
from hapticd.hil.daemon import DaemonProcess
from hapticd.hil.device import Device
from sim_hw.log import COMMAND, DISABLE, read_log
from tests.firmware.builds import require
from tests.polling import wait_until

pytestmark = pytest.mark.realtime

RATE_HZ = 100.0
WATCHDOG_MS = 60
MIDDLE = 1 << 13


@pytest.mark.usefixtures("forked")
@pytest.mark.parametrize("board", ["host", "mps2-an385"])
def test_sigstop_of_the_daemon(board: str, tmp_path: Path) -> None:
    require(board)
    config = parse_config(
        {
            "servo": {"rate_hz": RATE_HZ, "overrun": {"fault_after": None}},
            "encoder": {"decimation": 217},  # half a tick is a current worth speaking of
            "driver": {"name": "serial_dac", "port": "-", "watchdog_ms": WATCHDOG_MS},
            "safety": {"missed_exchanges": 10, "heartbeat_timeout_s": 10},
        },
        "test",
    )
    device = Device(config, tmp_path, board=board)
    with device:
        device.wait_ready()
        with DaemonProcess(config, tmp_path / "d", device.options) as daemon:
            daemon.wait_ready()
            daemon.client.start()
            daemon.wait_state("running")
            time.sleep(0.2)
            daemon.signal(signal.SIGSTOP)
            stopped_ns = time.monotonic_ns()
            wait_until(lambda: DISABLE in read_log(device.log_path)["event"], "the watchdog's work")
            log = read_log(device.log_path)
    off = int(np.flatnonzero(log["event"] == DISABLE)[0])
    commands = log[:off][log["event"][:off] == COMMAND]
    assert commands["code"][-1] != MIDDLE  # current flowed until then
    assert log["command_A"][off] == 0.0
    words = log[off:][log["event"][off:] == COMMAND]["code"]
    assert words[0] == MIDDLE
    assert set(words.tolist()) == {MIDDLE}
    # By the board's own clock: the watchdog's time, within the millisecond that the protocol allows.
    acted_ms = (int(log["detail"][off]) - int(commands["detail"][-1])) * 1e-3
    assert WATCHDOG_MS <= acted_ms + 0.01 <= WATCHDOG_MS + 1.01
    # By the host's clock, from the stop: the same and one tick at most, and what this machine takes to look.
    after_ms = (log["time_ns"][off] - stopped_ns) * 1e-6
    assert after_ms <= WATCHDOG_MS + 1e3 / RATE_HZ + 5.0
