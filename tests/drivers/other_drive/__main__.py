"""The drive as a process: ``python -m tests.drivers.other_drive canopen --socket PATH``, with the options of our own."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from types import FrameType

import yaml

from tests.drivers.other_drive.axis import Axis
from tests.drivers.other_drive.book import Book
from tests.drivers.other_drive.drive import Drive
from tests.drivers.other_drive.wires import Hub, PythonCan, SlcanAdapter, Wire


def main(arguments: Sequence[str] | None = None) -> int:
    """Be a drive until SIGTERM."""
    parser = argparse.ArgumentParser()
    parser.add_argument("device", choices=["canopen"])
    for name in ("--socket", "--slcan", "--plant", "--script", "--log"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--interface")
    parser.add_argument("--channel")
    parser.add_argument("--node-id", type=int, default=1)
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--missing", action="append", default=[])
    given = parser.parse_args(arguments)
    script = (yaml.safe_load(given.script.read_text()) if given.script else None) or {}
    script["start"] = start = dict(script.get("start") or {})
    start["override"] = {**(start.get("override") or {})} | {
        name: int(value, 0) for name, value in (one.split("=") for one in given.set)
    }
    start["missing"] = [*(start.get("missing") or ()), *given.missing]
    wire: Wire
    if given.socket:
        wire = Hub(given.socket)
    elif given.slcan:
        wire = SlcanAdapter(given.slcan)
    else:
        wire = PythonCan(interface=given.interface, channel=given.channel)
    axis = Axis()
    if given.plant:
        plant = yaml.safe_load(given.plant.read_text())
        axis.inertia, axis.viscous, axis.coulomb = (plant["plant"][key] for key in ("inertia", "viscous", "coulomb"))
        axis.torque_constant = plant["amplifier"]["torque_constant"]
    ended: list[int] = []

    def end(number: int, frame: FrameType | None) -> None:
        ended.append(number)

    signal.signal(signal.SIGTERM, end)
    drive = Drive(wire, given.node_id, axis, Book(given.log), script)
    signal.signal(signal.SIGUSR1, lambda number, frame: drive.signalled())
    print(json.dumps({"ready": True, "device": "canopen", "pid": os.getpid()}), flush=True)
    with contextlib.suppress(PermissionError):  # before what else runs here, as a processor of its own would be
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(60))
    drive.serve(lambda: bool(ended))
    return 0


if __name__ == "__main__":
    sys.exit(main())
