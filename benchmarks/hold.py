"""Whether daemon and simulated devices hold their rate: 1 kHz for 60 s on the compiled paths, 200 Hz over udp_multicast.

Named peer: the wall clock. What is missed is counted on both sides: by the daemon (periods, exchanges) and in the device's
own log (samples it served). On an ordinary kernel the bytes of a pseudo-terminal are carried by a kernel thread at
ordinary priority, which is where most missed exchanges of the serial path come from.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import Figure, progress
from hapticd.client import RequestRefused
from hapticd.config import parse_config
from hapticd.hil.daemon import DaemonProcess
from hapticd.hil.device import Device
from hapticd.hil.device_log import SAMPLE

PATHS: dict[str, tuple[float, dict[str, Any]]] = {
    "serial board, pty": (1000.0, {"name": "serial_dac", "port": "/dev/null"}),
    "CAN, Unix socket": (1000.0, {"name": "canopen", "interface": "unix_seqpacket", "channel": "-"}),
    "CAN, udp_multicast": (200.0, {"name": "canopen", "interface": "udp_multicast", "channel": "239.74.163.78"}),
}


def hold(rate_hz: float, driver: dict[str, Any], seconds: float) -> dict[str, Any]:
    """One path, the spring rendered all the time."""
    sections = {
        "driver": driver,
        "servo": {"rate_hz": rate_hz, "overrun": {"fault_after": None}},
        "safety": {"missed_exchanges": round(0.05 * rate_hz), "heartbeat_timeout_s": 10},
    }
    with tempfile.TemporaryDirectory(prefix="hapticd-hold-") as name:
        config = parse_config(sections, "benchmark")
        device = Device(config, Path(name))
        with device:
            device.wait_ready()
            with DaemonProcess(config, Path(name), device.options) as daemon:
                daemon.wait_ready()
                daemon.client.start()
                daemon.wait_state("running")
                before = daemon.client.status()
                time.sleep(seconds)
                after = daemon.client.status()
        served = int(np.sum(device.read_log().event == SAMPLE))
    ticks = after["timing"]["ticks"] - before["timing"]["ticks"]
    return {
        "rate_hz": rate_hz,
        "state": after["state"],
        "ticks": ticks,
        "missed_periods": after["timing"]["missed"] - before["timing"]["missed"],
        "missed_exchanges": after["exchanges_missed"] - before["exchanges_missed"],
        "samples_served": served,
        "late_p99_us": after["timing"]["wake_us"]["p99"],
    }


def measure(quick: bool) -> list[Figure]:
    """Share of the exchanges that were missed, path by path."""
    seconds = 2.0 if quick else 60.0
    figures = []
    for name, (rate_hz, driver) in PATHS.items():
        try:
            found = hold(rate_hz, driver, seconds)
        except RequestRefused as refused:  # a fault in the first moments, or before the answer: it does not hold
            found = {"rate_hz": rate_hz, "ticks": 0, "missed_exchanges": 1, "refused": str(refused)}
        progress(f"{name}: {found}")
        share = 100.0 * found["missed_exchanges"] / max(found["ticks"], 1)
        figures.append(Figure(f"{name} at {rate_hz:g} Hz: exchanges missed", share, "%", details=found))
    return figures
