"""What a recording loses while its disk hangs: the write call of the run file does not return for 30 s, at 10 kHz.

``python -m benchmarks.disk_hang [--seconds S] [--rows N]``; ``--rows`` makes the ring smaller than the hang, to see
that what is lost is said. The rig is the daemon's own, on the loopback; only ``os.write`` of the run file is held up.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from hapticd.config import parse_config
from hapticd.record import read_run, verify, writer
from hapticd.record.schema import FLAG_MISSED_PERIOD
from hapticd.service.rig import Rig
from hapticd.servo import thread

RATE_HZ = 10_000


class HangingDisk:
    """Stands where ``os`` does for the writer: writes wait while it hangs."""

    def __init__(self) -> None:
        self._over = threading.Event()
        self._over.set()

    def __getattr__(self, name: str) -> Any:
        return getattr(os, name)

    def write(self, descriptor: int, data: Any) -> int:
        """Write, once the disk answers."""
        self._over.wait()
        return os.write(descriptor, data)

    def hang(self) -> None:
        """Answer no more."""
        self._over.clear()

    def answer(self) -> None:
        """The hang is over."""
        self._over.set()


def trial(seconds: float, rows: int | None = None) -> dict[str, Any]:
    """One recording with a hang in it.

    Args:
        seconds: how long the disk hangs.
        rows: of the ring; None: what the daemon takes.

    Returns:
        ``recorded``, ``lost`` (by the ticks that are missing), ``told`` (rows that the file's events say are missing),
        ``stalled_s`` (as the file says), ``intact``.
    """
    disk = HangingDisk()
    writer.os = disk  # type: ignore[attr-defined]
    if rows is not None:
        thread.ring_rows = lambda rate_hz: rows  # type: ignore[assignment]
    with tempfile.TemporaryDirectory(prefix="hapticd-hang-") as folder:
        config = {
            "servo": {"rate_hz": RATE_HZ, "overrun": {"fault_after": None}},
            "safety": {"heartbeat_timeout_s": 10},
            "record": {"directory": folder},
        }
        rig = Rig(parse_config(config, "the benchmark's config"))
        try:
            path = rig.recorder.start(Path(folder) / "run.arrow")
            for part in (0.5, seconds, 0.5):
                if part is seconds:
                    disk.hang()
                end = time.monotonic() + part
                while time.monotonic() < end:
                    rig.servo.beat()
                    time.sleep(0.02)
                disk.answer()
            rig.recorder.stop()
        finally:
            disk.answer()
            rig.close()
        run = read_run(path)
        intact = verify(path).intact
    tick, flags = run.columns["tick"], run.columns["flags"]
    gaps = (np.diff(tick) > 1) & ((flags[1:] & FLAG_MISSED_PERIOD) == 0)
    return {
        "hang_s": seconds,
        "rate_hz": RATE_HZ,
        "recorded": run.rows,
        "lost": int(np.sum((np.diff(tick) - 1)[gaps])),
        "told": sum(event["rows"] for event in run.events if event["event"] == "dropped"),
        "stalled_s": sum(event["seconds"] for event in run.events if event["event"] == "stalled"),
        "intact": intact,
    }


def main() -> int:
    """Run it; 1 when a row is missing of which the file says nothing, or the file is damaged."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.disk_hang", description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--rows", type=int)
    options = parser.parse_args()
    found = trial(options.seconds, options.rows)
    print(json.dumps(found))
    return 0 if found["intact"] and found["told"] >= found["lost"] else 1


if __name__ == "__main__":
    sys.exit(main())
