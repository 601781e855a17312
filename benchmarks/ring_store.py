"""What a store into the flight recorder's ring costs the servo thread when the ring is a file: in memory, or on a disk.

A page of a file on a disk is write-protected each time the kernel writes it back; the next store into it faults, and the
file system may have it wait for its journal. A memory file system has no writeback. Beside the stores, another process
appends to a file on the disk and syncs the disk, which the kernel does by itself every few seconds.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import Figure, progress
from hapticd.jit import njit
from hapticd.record.flight import FlightRing, memory_directory
from hapticd.servo.clock import now_ns, sleep_until

RATE_HZ = 10_000
_LOAD = """
import os, sys
file = os.open(sys.argv[1], os.O_WRONLY | os.O_CREAT)
block = os.urandom(1 << 20)
while True:
    for _ in range(16):
        os.write(file, block)
    os.sync()
    if os.fstat(file).st_size > 1 << 28:
        os.ftruncate(file, 0)
        os.lseek(file, 0, os.SEEK_SET)
"""


@njit()
def _store(rows: Any, timespec: Any, stores: int, period_ns: int, took_ns: Any) -> None:
    due = now_ns(timespec)
    for number in range(stores):
        due += period_ns
        sleep_until(timespec, due)
        before = now_ns(timespec)
        rows[number & (len(rows) - 1)].tick = number
        took_ns[number] = now_ns(timespec) - before


def _worst_us(directory: Path, seconds: float) -> dict[str, float]:
    stores = int(seconds * RATE_HZ)
    took = np.zeros(stores, np.int64)
    timespec = np.zeros(2, np.int64)
    ring = FlightRing.create(directory, "ring-store", 1 << 16)
    with tempfile.NamedTemporaryFile(dir=Path.cwd()) as file:
        load = subprocess.Popen([sys.executable, "-c", _LOAD, file.name])
        try:
            _store(ring.rows, timespec, 1, 1000, took)
            faults = -_faults()
            _store(ring.rows, timespec, stores, 1_000_000_000 // RATE_HZ, took)
            faults += _faults()
        finally:
            load.kill()
            load.wait()
            ring.remove()
    late = {f"p{q:g}": float(np.percentile(took, q)) / 1e3 for q in (50, 99, 99.9, 100)}
    return {**late, "faults": faults, "above 50 µs": int(np.count_nonzero(took > 50_000))}


def _faults() -> int:
    return resource.getrusage(resource.RUSAGE_THREAD).ru_minflt


def measure(quick: bool) -> list[Figure]:
    """Time of one store, the ring in memory and on the disk of the working directory's file system."""
    seconds = 2.0 if quick else 60.0
    places = {"memory": memory_directory() or Path("/dev/shm"), "disk": Path.cwd()}
    figures = []
    for name, directory in places.items():
        progress(f"storing at {RATE_HZ} Hz for {seconds:g} s into a ring in {name}")
        directory.mkdir(mode=0o700, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=directory, prefix="hapticd-") as folder:
            times = _worst_us(Path(folder), seconds)
        details = {**times, "seconds": seconds}
        figures.append(
            Figure(f"page faults of the storing thread, ring in {name}", times["faults"], "", details=details)
        )
        figures.append(Figure(f"stores above 50 µs, ring in {name}", times["above 50 µs"], ""))
    return figures
