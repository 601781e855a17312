"""A daemon on a simulated device in a process of its own, whose log is the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, TypeAlias

from hapticd.config import Config, parse_config
from hapticd.service.daemon import Daemon
from hapticd.service.latch import FaultLatch
from tests import forked
from tests.sim_hw.boards import running_board

from .daemons import SOCKET

Device: TypeAlias = Callable[..., AbstractContextManager[tuple[Config, Path]]]

WATCHDOG_MS = {"serial_dac": 200, "canopen": 1000}
LONGEST_GAP = 150
"""Exchanges that may fail before the fault: a busy machine loses some, and a device that is away for a second more."""
ORIGIN_RAD = 0.3
"""Far from where the shaft rests, so that there is a current at once."""


def device_config(runs: Path, name: str, **driver: Any) -> Config:
    """A daemon's config for a simulated device; beside its name the driver's options."""
    data = {
        "servo": {"rate_hz": 500, "overrun": {"fault_after": None}},
        "spring": {"origin": ORIGIN_RAD},
        "amplifier": {} if name == "serial_dac" else {"dac_bits": 0},
        "driver": {"name": name, "watchdog_ms": WATCHDOG_MS[name], "reconnect": True, **driver},
        "safety": {"heartbeat_timeout_s": 10, "missed_exchanges": LONGEST_GAP},
        "record": {"directory": str(runs)},
    }
    return parse_config(data, "test")


@contextmanager
def board(folder: Path, script: str = "", **options: Any) -> Iterator[tuple[Config, Path]]:
    """A serial board on a pseudo-terminal; its config and its log."""
    with running_board(folder, script) as device:
        yield device_config(folder / "runs", "serial_dac", port=str(device.link), **options), device.log


@contextmanager
def drive(folder: Path, script: str = "", **options: Any) -> Iterator[tuple[Config, Path]]:
    """A CANopen drive on a bus of its own; its config and its log."""
    log, socket = folder / "truth.arrow", folder / "bus"
    with powered_drive(folder, log, script):
        yield device_config(folder / "runs", "canopen", interface="unix_seqpacket", channel=str(socket), **options), log


@contextmanager
def powered_drive(folder: Path, log: Path, script: str = "") -> Iterator[None]:
    """The drive's process, from power-on to power-off."""
    (folder / "script.yaml").write_text(script or "{}")
    arguments = ["--socket", str(folder / "bus"), "--log", str(log), "--script", str(folder / "script.yaml")]
    process = forked.device(["canopen", *arguments], folder)
    try:
        assert process.stdout.readline()
        yield
    finally:
        process.close()


@contextmanager
def daemon_of(settings: Config) -> Iterator[Daemon]:
    """A daemon on it."""
    daemon = Daemon(settings, "rig.yaml", FaultLatch(SOCKET))
    try:
        yield daemon
    finally:
        daemon.shutdown()
