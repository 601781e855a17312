"""Run the cases on the cores of this machine or on a Dask cluster; every result is one JSON file, whole or absent.

<root>/cases/<case>/…   what the workflow is given        <root>/truth/<case>.json      sealed until scoring
<root>/workflow/<case>.json, <root>/peer/<case>.json      what was answered
"""

from __future__ import annotations

import contextlib
import importlib
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from pathlib import Path
from typing import Any

from benchmarks.gap import tasks
from benchmarks.gap.cases import Files, write_files, write_json
from benchmarks.gap.plan import Case

ANSWERERS: dict[str, Callable[[Files, Sequence[str]], dict[str, Any]]] = {
    "workflow": tasks.workflow,
    "peer": tasks.peer,
}
"""Who answers, and the name of the folder of the answers."""

_ONE_THREAD = dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")


class ClusterError(Exception):
    """The Dask cluster cannot be used; the text says why."""


def _begin_worker() -> None:
    os.setpriority(os.PRIO_PROCESS, 0, max(10, os.getpriority(os.PRIO_PROCESS, 0)))
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextlib.contextmanager
def local(jobs: int) -> Iterator[Executor]:
    """Processes of this machine, one thread each, at low priority; leaving the block early ends them."""
    os.environ.update(_ONE_THREAD)
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _begin_worker)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


@contextlib.contextmanager
def dask(address: str, connect_s: float = 10.0) -> Iterator[Executor]:
    """The workers of a Dask cluster, which must have hapticd and this folder.

    Raises:
        ClusterError: ``distributed`` is not installed here, or there is no scheduler.
    """
    try:
        distributed: Any = importlib.import_module("distributed")
        client = distributed.Client(address, timeout=connect_s, set_as_default=False)
    except ImportError as error:
        raise ClusterError(f"--dask needs the package 'distributed': {error}") from None
    except (OSError, ValueError) as error:
        raise ClusterError(f"no Dask scheduler at {address}: {error or type(error).__name__}") from error
    with client, client.get_executor(pure=False, retries=3) as pool:
        yield pool


class Store:
    """The folder of a benchmark."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def answer_path(self, who: str, case: Case) -> Path:
        """Where an answer is or will be."""
        return self.root / who / f"{case.name}.json"

    def truth_path(self, case: Case) -> Path:
        """Where the truth is."""
        return self.root / "truth" / f"{case.name}.json"

    def files(self, case: Case) -> Files | None:
        """What the workflow is given, if it has been made whole."""
        folder = self.root / "cases" / case.name
        if not self.truth_path(case).exists():  # written last
            return None
        return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}

    def put(self, case: Case, made: tasks.Made) -> Files:
        """Keep a made case."""
        files, truth = made
        write_files(self.root / "cases" / case.name, files)
        write_json(self.truth_path(case), {"name": case.name, **truth})
        return files

    def missing(self, case: Case, who: Sequence[str]) -> list[str]:
        """Whose answers are still to come."""
        return [name for name in who if not self.answer_path(name, case).exists()]


def run(
    cases: Sequence[Case],
    store: Store,
    who: Sequence[str],
    pool: Executor,
    jobs: int,
    progress: Callable[[float], None] = lambda fraction: None,
    note: Callable[[str], None] = lambda text: None,
) -> None:
    """Fill the store with what is missing; whatever ends it, what is finished is kept and not done again.

    Args:
        cases: of the plan.
        store: the benchmark's folder.
        who: keys of `ANSWERERS`.
        pool: where tasks run.
        jobs: how many tasks to keep going.
        progress: called with the fraction done.
        note: called with a line on a case that could not be made.
    """
    open_cases = deque(case for case in cases if store.missing(case, who))
    ready: deque[tuple[str, Case, Files]] = deque()
    total = sum(len(store.missing(case, who)) for case in open_cases) or 1
    done = 0
    waiting: dict[Future[Any], tuple[str, Case]] = {}

    def offer(case: Case, files: Files) -> None:
        ready.extend((name, case, files) for name in store.missing(case, who))

    while True:
        while len(waiting) < 2 * jobs:
            if ready:
                name, case, files = ready.popleft()
                waiting[pool.submit(ANSWERERS[name], files, case.excluded)] = name, case
            elif open_cases:
                case = open_cases.popleft()
                if (known := store.files(case)) is not None:
                    offer(case, known)
                else:
                    waiting[pool.submit(tasks.make, case)] = "make", case
            else:
                break
        if not waiting:
            return
        for future in wait(waiting, return_when=FIRST_COMPLETED).done:
            name, case = waiting.pop(future)
            if name != "make":
                write_json(store.answer_path(name, case), future.result())
                done += 1
            elif isinstance(future.exception(), tasks.UnstableError):
                note(f"left out: {future.exception()}")
                done += len(who)
            else:
                offer(case, store.put(case, future.result()))
            progress(done / total)
