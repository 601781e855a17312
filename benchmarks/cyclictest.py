"""The peer: ``cyclictest`` of rt-tests at the servo's priority and period, with every sample in ns."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.report import NotHereError, progress

if TYPE_CHECKING:
    from numpy.typing import NDArray

PEER = "cyclictest"
_LONGEST_NS = 1_000_000
"""Beyond it cyclictest only counts, so such a sample is entered with the maximum."""


def require() -> None:
    """Find cyclictest, or install the package rt-tests when that is possible.

    Raises:
        NotHereError: it is missing and cannot be installed.
    """
    if shutil.which("cyclictest"):
        return
    if os.geteuid() != 0 or not shutil.which("apt-get"):
        raise NotHereError("cyclictest is missing: install the package rt-tests ('sudo apt-get install rt-tests')")
    progress("installing rt-tests, for cyclictest")
    update = subprocess.run(["apt-get", "update"], capture_output=True, text=True, check=False)
    install = subprocess.run(["apt-get", "install", "-y", "rt-tests"], capture_output=True, text=True, check=False)
    if install.returncode != 0:
        last = (install.stderr or update.stderr).strip().splitlines()[-1:]
        raise NotHereError(f"cyclictest is missing, and 'apt-get install rt-tests' failed: {' '.join(last)}")


def lateness_ns(seconds: int, period_ns: int = 1_000_000, priority: int = 80) -> NDArray[np.float64]:
    """How late each cycle woke, ns, shape (cycles,), sorted.

    Raises:
        NotHereError: cyclictest may not run at this priority here.
    """
    with tempfile.TemporaryDirectory(prefix="hapticd-benchmark-") as folder:
        result = Path(folder) / "cyclictest.json"
        command = ["cyclictest", "-p", str(priority), "-i", str(period_ns // 1000), "-t1", "-m", "-q", "-N"]
        command += ["-h", str(_LONGEST_NS), "--histfile=/dev/null", f"--json={result}", "-D", str(seconds)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0 or not result.exists():
            raise NotHereError(f"cyclictest failed (it needs root or an rtprio limit of {priority}): {done.stderr}")
        thread = json.loads(result.read_text())["thread"]["0"]
    values = np.array([int(value) for value in thread["histogram"]], dtype=np.float64)
    counts = np.array(list(thread["histogram"].values()), dtype=np.int64)
    beyond = max(int(thread["cycles"]) - int(counts.sum()), 0)
    return np.sort(np.concatenate([np.repeat(values, counts), np.full(beyond, float(thread["max"]))]))
