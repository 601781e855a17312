"""Run the cases on the cores of this machine or on a Dask cluster; every result is one JSON file, whole or absent.

<root>/cases/<case>/…       what the workflow is given        <root>/truth/<case>.json      sealed until scoring
<root>/<who>/<case>.json    what was answered
"""

from __future__ import annotations

import contextlib
import importlib
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from benchmarks.gap import tasks
from benchmarks.gap.cases import Files, write_files, write_json


class Case(Protocol):
    """What is answered one by one; hashable."""

    @property
    def name(self) -> str:
        """Of its files."""

    @property
    def excluded(self) -> Sequence[str]:
        """Names that are not allowed."""


class Asked(NamedTuple):
    """Someone who answers."""

    answer: Callable[[Files, Sequence[str]], dict[str, Any]]
    """Takes a case's files and the names that are not allowed; must be picklable."""
    most: int | None = None
    """How many cases, from the first on; None for all."""


class ClusterError(Exception):
    """The Dask cluster cannot be used; the text says why."""


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


def run(
    cases: Sequence[Case],
    store: Store,
    who: Mapping[str, Asked],
    pool: Executor,
    jobs: int,
    progress: Callable[[float], None] = lambda fraction: None,
    note: Callable[[str], None] = lambda text: None,
    make: Callable[[Any], tasks.Made] = tasks.make,
) -> None:
    """Fill the store with what is missing; whatever ends it, what is finished is kept and not done again.

    Args:
        cases: of the plan.
        store: the benchmark's folder.
        who: folder of the answers, and who gives them.
        pool: where tasks run.
        jobs: how many tasks to keep going.
        progress: called with the fraction done.
        note: called with a line on a case that could not be made.
        make: makes a case; must be picklable.
    """
    missing = {case: _missing(index, case, store, who) for index, case in enumerate(cases)}
    open_cases = deque(case for case, names in missing.items() if names)
    ready: deque[tuple[str, Case, Files]] = deque()
    total = sum(map(len, missing.values())) or 1
    done = 0
    waiting: dict[Future[Any], tuple[str, Case]] = {}

    def offer(case: Case, files: Files) -> None:
        ready.extend((name, case, files) for name in missing[case])

    while True:
        while len(waiting) < 2 * jobs:
            if ready:
                name, case, files = ready.popleft()
                waiting[pool.submit(who[name].answer, files, case.excluded)] = name, case
            elif open_cases:
                case = open_cases.popleft()
                if (known := store.files(case)) is not None:
                    offer(case, known)
                else:
                    waiting[pool.submit(make, case)] = "", case
            else:
                break
        if not waiting:
            return
        for future in wait(waiting, return_when=FIRST_COMPLETED).done:
            name, case = waiting.pop(future)
            if name:
                write_json(store.answer_path(name, case), future.result())
                done += 1
            elif isinstance(future.exception(), tasks.UnstableError):
                note(f"left out: {future.exception()}")
                done += len(missing[case])
            else:
                offer(case, store.put(case, future.result()))
            progress(done / total)


def _missing(index: int, case: Case, store: Store, who: Mapping[str, Asked]) -> list[str]:
    """Whose answers on a case are still to come."""
    return [
        name
        for name, asked in who.items()
        if (asked.most is None or index < asked.most) and not store.answer_path(name, case).exists()
    ]
