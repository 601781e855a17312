"""Worker processes of the benchmark: they end with the process that started them, and know what memory a case took."""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import resource
import signal
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path

_ONE_THREAD = dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
_PR_SET_PDEATHSIG = 1
_RESET_PEAK = "5"


def end_with_parent() -> None:
    """Have the kernel kill this process when its parent is gone, however that ended (prctl(2), PR_SET_PDEATHSIG)."""
    parent = os.getppid()
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGKILL)


def end_on_sigterm() -> None:
    """Let SIGTERM leave this process like an exit, so that what it holds is given back and its workers are ended."""
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))


def _begin_worker(scratch: str) -> None:
    end_with_parent()
    tempfile.tempdir = scratch
    os.setpriority(os.PRIO_PROCESS, 0, max(10, os.getpriority(os.PRIO_PROCESS, 0)))
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


@contextlib.contextmanager
def pool(jobs: int) -> Iterator[Executor]:
    """Processes of this machine, one thread each, at low priority; leaving the block early ends them at once."""
    os.environ.update(_ONE_THREAD)
    before = set(multiprocessing.active_children())
    # Killed workers cannot clean up: their temporary files are in a folder that goes with the block.
    with tempfile.TemporaryDirectory(prefix="gap-") as scratch:
        context = multiprocessing.get_context("spawn")
        workers = ProcessPoolExecutor(jobs, context, _begin_worker, (scratch,))
        try:
            yield workers
        except BaseException:
            for process in set(multiprocessing.active_children()) - before:
                process.kill()
            raise
        finally:
            workers.shutdown(cancel_futures=True)


def forget_peak_memory() -> None:
    """Let `peak_memory_mb` count from now on, where the kernel allows it (proc(5), clear_refs)."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text(_RESET_PEAK)


def peak_memory_mb() -> float:
    """The most memory that this process had since `forget_peak_memory`, MB."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) / 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
