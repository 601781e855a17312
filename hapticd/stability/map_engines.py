"""Engines that compute the chunks of a region map: the cores of this machine, or the workers of a Dask cluster.

Both call the same function for each chunk and yield results as they arrive. Chunks are independent, so on processors of
one kind every bit is the same in any order, on any worker, and after a repetition for a lost worker.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Any

from hapticd.stability.maps import Chunk, PointArray, run_chunk

Results = Generator[tuple[Chunk, PointArray]]


class ClusterError(Exception):
    """The cluster cannot be used; the text says why and what to do."""


def local(chunks: Sequence[Chunk], jobs: int | None = None) -> Results:
    """Compute chunks on threads of this process; the compiled kernel releases the GIL.

    Closing the iterator, or an interrupt while it waits, ends the work after the present chunks.

    Args:
        chunks: what to compute.
        jobs: number of threads; None for one per core that this process may use.
    """
    jobs = jobs or len(os.sched_getaffinity(0))
    pool = ThreadPoolExecutor(jobs, thread_name_prefix="map")
    queue = iter(chunks)
    waiting: dict[Future[PointArray], Chunk] = {}
    try:
        while True:
            while len(waiting) < 2 * jobs and (chunk := next(queue, None)) is not None:
                waiting[pool.submit(run_chunk, chunk)] = chunk
            if not waiting:
                return
            for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                yield waiting.pop(future), future.result()
    finally:
        pool.shutdown(cancel_futures=True)


def dask(chunks: Sequence[Chunk], address: str, connect_s: float = 10.0) -> Results:
    """Compute chunks on the workers of a Dask cluster; the chunk of a lost worker is computed again by another.

    Args:
        chunks: what to compute.
        address: of the scheduler, e.g. ``tcp://host:8786``. Its workers must have hapticd installed.
        connect_s: longest wait for the scheduler [s].

    Raises:
        ClusterError: ``distributed`` is not installed here, there is no scheduler, or a chunk failed on a worker.
    """
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError as error:
        raise ClusterError(
            f"--dask needs the Python package 'distributed' ({error}): pip install 'hapticd[dask]'"
        ) from None
    try:
        client = distributed.Client(address, timeout=connect_s, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterError(f"no Dask scheduler at {address}: {error or type(error).__name__}") from error
    with client:
        # pure=False: a new task for every chunk, not the cached result of an earlier study
        futures = client.map(run_chunk, list(chunks), pure=False, retries=3)
        of = {future.key: chunk for future, chunk in zip(futures, chunks, strict=True)}
        try:
            for future in distributed.as_completed(futures, loop=client.loop):
                try:
                    # waits again if the worker with this result was lost
                    points = future.result()
                except Exception as error:
                    raise ClusterError(f"a chunk could not be computed: {error!r}") from error
                yield of[future.key], points
                future.release()
        finally:
            client.cancel(futures)
