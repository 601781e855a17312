"""MATLAB files up to ``-v7``, read by scipy in a process of its own with limits (`hapticd.record.mat_child`).

scipy's reader trusts the file's own type codes and sizes: one wrong byte can end the process that it runs in.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.record import sizes
from hapticd.record.errors import RunFileError

_CHILD: Final = Path(__file__).with_name("mat_child.py")
_HDF5: Final = b"\x89HDF"
_HEADER_BYTES: Final = 128
_TOO_LARGE: Final = 4
_PATIENCE_S: Final = 120.0


def read_mat(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Every array by its name (``a.b``, ``Y(2).Data``, ``c{3}``), dimensions of one element dropped; and what is left out.

    Raises:
        RunFileError: it is no MATLAB file, damaged, of HDF5 (``save -v7.3``), or unpacks to too much.
    """
    with path.open("rb") as file:
        head = file.read(_HEADER_BYTES)
    if head.startswith(_HDF5) or head[124:128] in (b"\x00\x02IM", b"\x02\x00MI"):
        raise RunFileError(f"{path} is a MATLAB 7.3 (HDF5) file; save it with -v7 in MATLAB")
    limit = sizes.unpack_limit(path.stat().st_size)
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as said:
        done = subprocess.run(
            [sys.executable, "-I", str(_CHILD), str(path.absolute()), str(limit >> 20)],
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=said,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            timeout=_PATIENCE_S,
            check=False,
        )
        said.seek(0)
        words = said.read(2000).decode(errors="replace").strip().splitlines()
        if done.returncode == _TOO_LARGE or (done.returncode and words and "MemoryError" in words[-1]):
            sizes.check_unpacked(path, limit + 1, limit)
        if done.returncode:
            ended = (
                f"its reader ended by {signal.Signals(-done.returncode).name}"
                if done.returncode < 0
                else "no reason told"
            )
            raise RunFileError(f"{path} is not a readable .mat file: {words[-1] if words else ended}")
        out.seek(0)
        contents = json.loads(out.readline())
        return {name: np.load(out, allow_pickle=False) for name in contents["names"]}, contents["left_out"]
