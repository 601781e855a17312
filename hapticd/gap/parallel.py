"""Parallel runs of the filter in threads: it does not hold Python's GIL.

Linear algebra uses one thread: its matrices are small, and with several threads rounding would differ from run to run.
"""

from __future__ import annotations

import os
import threading
from concurrent.futures import CancelledError, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, TypeVar, cast

from threadpoolctl import threadpool_limits

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

Given = TypeVar("Given")
Found = TypeVar("Found")
Function = TypeVar("Function", bound="Callable[..., Any]")

_thread = threading.local()


def one_blas_thread(function: Function) -> Function:
    """Limit linear algebra to one thread during a function."""
    return cast("Function", threadpool_limits.wrap(limits=1, user_api="blas")(function))


def parallel_map(function: Callable[[Given], Found], items: Iterable[Given]) -> list[Found]:
    """Results of a function for each item, in order, computed on all processors that the process may use.

    A nested call runs sequentially. After an error or Ctrl-C all threads end at their next `check_cancelled`.
    """
    if hasattr(_thread, "stop"):
        return [function(item) for item in items]
    stop = threading.Event()
    with ThreadPoolExecutor(len(os.sched_getaffinity(0)), initializer=_join, initargs=(stop,)) as pool:
        try:
            return list(pool.map(function, items))
        except BaseException:
            stop.set()
            raise


def _join(stop: threading.Event) -> None:
    _thread.stop = stop


def check_cancelled() -> None:
    """Called in long computations within `parallel_map`.

    Raises:
        CancelledError: another thread failed.
    """
    if hasattr(_thread, "stop") and _thread.stop.is_set():
        raise CancelledError
