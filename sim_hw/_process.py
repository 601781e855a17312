"""The process of a simulated device: ready line, signals, real-time priority, and the thread that writes the log."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sim_hw import layout as w
from sim_hw.log import LogWriter

if TYPE_CHECKING:
    from sim_hw.layout import Sim

PRIORITY = 70
"""SCHED_FIFO priority of a device's service, below the daemon's servo loop."""
_DRAIN_S = 0.02


def run_device(
    sim: Sim, serve: Callable[[], None], log_path: Path | None, device: str, ready: Mapping[str, object]
) -> None:
    """Run a device until SIGTERM or SIGINT, or until its service ends; must be called from the main thread.

    The service runs in its own thread, under SCHED_FIFO if that is granted. This thread prints one JSON line on
    stdout (``ready``, ``device``, ``pid``, and those of ``ready``), then writes the log. On one of these signals it
    sets the service's STOP word, waits for it, and writes the log to its end. SIGUSR1 begins the script's next fault
    that waits for a signal.

    Args:
        sim: the device's memory. serve: the service; returns soon after ``sim.s[STOP]`` is set.
        log_path: of the log; None for no log.
        device: its name. ready: further keys of the ready line.

    Raises:
        OSError: the log cannot be written.
        BaseException: the service's exception.
    """
    ended = threading.Event()
    raised: list[BaseException] = []

    def body() -> None:
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        try:
            serve()
        except BaseException as error:
            raised.append(error)
        finally:
            ended.set()

    def stop(number: int, frame: object) -> None:
        sim.s[w.STOP] = 1

    def signalled(number: int, frame: object) -> None:
        for fault in sim.faults:
            if fault[w.FAULT_STATE] == w.UNSIGNALLED:
                fault[w.FAULT_AT_NS] += time.monotonic_ns() - sim.s[w.START_NS]
                fault[w.FAULT_STATE] = w.WAITING
                break

    writer = LogWriter(log_path, {"device": device}) if log_path else None
    try:
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, stop)
        signal.signal(signal.SIGUSR1, signalled)
        thread = threading.Thread(target=body, name=f"sim-{device}")
        thread.start()
        print(json.dumps({"ready": True, "device": device, **ready, "pid": os.getpid()}), flush=True)
        try:
            while not ended.wait(_DRAIN_S):
                _drain(sim, writer)
        finally:
            sim.s[w.STOP] = 1
            thread.join()
            _drain(sim, writer)
    finally:
        if writer is not None:
            writer.close()
    if lost := int(sim.s[w.LOG_DROPPED]):
        print(f"{device}: {lost} rows of the log were lost: the disk was too slow", file=sys.stderr)
    if raised:
        raise raised[0]


def _drain(sim: Sim, writer: LogWriter | None) -> None:
    head, tail = int(sim.s[w.LOG_HEAD]), int(sim.s[w.LOG_TAIL])
    while tail < head:
        first = tail % w.RING_ROWS
        rows = sim.ring[first : min(first + head - tail, w.RING_ROWS)]
        if writer is not None:
            writer.write(rows)
        tail += rows.size
        sim.s[w.LOG_TAIL] = tail


def add_common_options(parser: Any) -> None:
    """Add the common options ``--plant``, ``--script``, ``--log`` to an ``argparse`` parser."""
    parser.add_argument(
        "--plant",
        metavar="FILE",
        help="the device's true plant: a configuration file or preset of which plant, hand, amplifier and "
        "encoder count (default: the built-in RE35 testbed)",
    )
    parser.add_argument("--script", metavar="FILE", type=Path, help="hand, start and faults, as YAML (default: none)")
    parser.add_argument(
        "--log", metavar="FILE", type=Path, help="write the true motion to this Arrow stream (default: no log)"
    )
