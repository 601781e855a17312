"""Where things are written: compiled code and recordings."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

from hapticd.doctor.finding import Finding, Level, Machine

if TYPE_CHECKING:
    from hapticd.config import Config

ROW_BYTES: Final = 80
_TRIAL_BYTES: Final = 16 << 20
_MARGIN: Final = 10.0
"""How much faster than the rows come the disk shall be."""
_HOUR_S: Final = 3600.0


def compiled_code(machine: Machine, config: Config) -> Finding:
    """Whether compiled code can be kept for the next start."""
    import numba

    import hapticd.jit

    folder = Path(numba.config.CACHE_DIR)
    existing = next(parent for parent in (folder, *folder.parents) if parent.exists())
    if os.access(existing, os.W_OK):
        return Finding("compiled code", Level.GOOD, f"kept in {folder}")
    return Finding(
        "compiled code",
        Level.NOTE,
        f"{folder} cannot be written",
        f"every start compiles the loop anew, about ten seconds ({hapticd.jit.__name__})",
        "set NUMBA_CACHE_DIR to a folder of this user",
    )


def disk(machine: Machine, config: Config) -> Finding:
    """How fast the disk takes recordings, and how long it will."""
    folder = Path(config.record.directory)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        speed = _speed(folder)
        free = shutil.disk_usage(folder).free
    except OSError as error:
        fix = f"mkdir -p {folder} && chown {os.environ.get('USER', 'hapticd')} {folder}"
        return Finding("recordings", Level.BAD, f"{folder}: {error.strerror}", "nothing can be recorded", fix)
    needed = ROW_BYTES * config.servo.rate_hz
    found = f"{speed / 1e6:.0f} MB/s in {folder}, {free / 1e9:.1f} GB free: {free / needed / _HOUR_S:.0f} h"
    if speed < needed * _MARGIN:
        matters = f"rows come at {needed / 1e6:.2g} MB/s; those that the disk cannot take are lost, and counted"
        return Finding("recordings", Level.NOTE, found, matters, "set record.directory to a faster disk")
    if free < needed * _HOUR_S:
        return Finding("recordings", Level.NOTE, found, "less than an hour's", f"make room in {folder}")
    return Finding("recordings", Level.GOOD, found)


def _speed(folder: Path) -> float:
    """Bytes per second of a file that is written and forced out."""
    block = os.urandom(1 << 20)
    with tempfile.TemporaryFile(dir=folder) as file:
        begin = time.perf_counter()
        for _ in range(_TRIAL_BYTES // len(block)):
            file.write(block)
        file.flush()
        os.fsync(file.fileno())
        return _TRIAL_BYTES / (time.perf_counter() - begin)


CHECKS: Final = (compiled_code, disk)
