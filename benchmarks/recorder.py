"""Whether the recorder keeps up at 10 kHz: rows dropped, its share of a CPU, bytes a row on disk."""

from __future__ import annotations

import time

import numpy as np

from benchmarks.daemon import MeasuredDaemon, lateness_ns
from benchmarks.report import Figure, progress
from hapticd.record import read_run

RATE_HZ = 10_000.0
RECORDER, SERVO = THREADS = ("hapticd-recorder", "hapticd-servo")


def measure(quick: bool) -> list[Figure]:
    """Figures of one recording, from before its start to after its end."""
    seconds = 2.0 if quick else 60.0
    with MeasuredDaemon({"servo.rate_hz": str(RATE_HZ)}) as daemon:
        progress(f"recording at {RATE_HZ:g} Hz for {seconds:g} s")
        path = daemon.new_path()
        asked = time.monotonic()
        daemon.client.record_start(path)
        began = time.monotonic()
        cpu_s = {name: -daemon.thread_cpu_s(name) for name in THREADS}
        time.sleep(seconds)
        for name in THREADS:
            cpu_s[name] += daemon.thread_cpu_s(name)
        elapsed = time.monotonic() - began
        daemon.client.record_stop()
        status = daemon.require_healthy()
        run, size = read_run(path), path.stat().st_size
    late = lateness_ns(run, RATE_HZ) / 1e3
    details = {
        "seconds": elapsed,
        "file_bytes": size,
        "periods_missed": int((np.diff(run.columns["tick"]) - 1).sum()),
        "late_us": {f"p{q:g}": float(np.percentile(late, q)) for q in (50, 99, 99.9, 100)},
    }
    return [
        Figure("rows dropped", status["recorder"]["dropped"], "rows", 0.0, details=details),
        Figure("rows recorded", run.rows, "rows"),
        Figure("recorder thread, share of one CPU", cpu_s[RECORDER] / elapsed * 100, "%"),
        Figure("servo thread, share of one CPU", cpu_s[SERVO] / elapsed * 100, "%"),
        Figure("on disk", size / run.rows, "bytes/row"),
        Figure("answer to the first 'record start'", (began - asked) * 1e3, "ms"),
    ]
