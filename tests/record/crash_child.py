"""Child process of the crash tests: `until_killed FOLDER CLOCK` or `until_full FOLDER [LIMIT_BYTES]`."""

from __future__ import annotations

import json
import mmap
import resource
import struct
import sys
import time
from pathlib import Path

from record_samples import Ring, wait_until

from hapticd.record import Recorder, RecordingError, read_run


def until_killed(folder: Path, clock: Path) -> None:
    """Record at 10 kHz for ever; the time of the newest row is left in a file shared with the parent."""
    with clock.open("r+b") as file:
        newest = mmap.mmap(file.fileno(), 8)
    ring = Ring()
    recorder = Recorder(ring.drain, lambda: 0, ring.history, dict, folder)
    path = recorder.start()
    while True:
        time.sleep(0.001)
        now = time.monotonic()
        ring.push(10, at=now)
        newest[:] = struct.pack("d", now)
        if ring.made == 5000:
            print(path, flush=True)


def until_full(folder: Path, limit: int | None) -> None:
    """Record until the disk is full, then show that the rest goes on."""
    if limit is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    ring = Ring()
    recorder = Recorder(ring.drain, lambda: 0, ring.history, dict, folder)
    path = recorder.start()
    while recorder.status()["state"] == "recording":
        ring.push(200)
        time.sleep(0.01)
    failed = recorder.status()
    ring.push(500)
    wait_until(lambda: not ring.chunks)
    try:
        recorder.dump_past("over_speed")
        dump = "written"
    except RecordingError as error:
        dump = str(error)
    stopped = recorder.stop()
    run = read_run(path)
    path.unlink()
    ring.push(5)
    again = recorder.start()
    ring.push(5)
    recorder.stop()
    ticks = run.columns["tick"].tolist()
    report = {
        "failed": failed,
        "stopped": str(stopped),
        "path": str(path),
        "made": ring.made,
        "left": len(ring.chunks),
        "truncated": run.truncated,
        "ticks_whole": ticks == list(range(len(ticks))),
        "rows": run.rows,
        "dump": dump,
        "again": read_run(again).rows,
    }
    print(json.dumps(report))


if __name__ == "__main__":
    mode, folder = sys.argv[1], Path(sys.argv[2])
    if mode == "until_killed":
        until_killed(folder, Path(sys.argv[3]))
    else:
        until_full(folder, int(sys.argv[3]) if len(sys.argv) > 3 else None)
