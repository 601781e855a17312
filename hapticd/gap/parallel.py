"""Independent runs of the filter beside each other: it holds no lock of Python's, so threads do.

Linear algebra stays on one thread: its matrices are small, and the order in which threads sum rounds differently each time.
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
    """A function during which linear algebra has one thread."""
    return cast("Function", threadpool_limits.wrap(limits=1, user_api="blas")(function))


def each(function: Callable[[Given], Found], items: Iterable[Given]) -> list[Found]:
    """What a function returns for each item, in their order, on all processors that the process may use.

    Called by such a function, it goes through its items one after the other: the processors have enough to do. After an
    error or Ctrl-C they all end at their next `go_on`.
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


def go_on() -> None:
    """Called by what takes long within `each`.

    Raises:
        CancelledError: another one failed.
    """
    if hasattr(_thread, "stop") and _thread.stop.is_set():
        raise CancelledError
