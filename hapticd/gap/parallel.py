"""Independent runs of the filter beside each other: it holds no lock of Python's, so threads do.

Linear algebra stays on one thread: its matrices are small, and the order in which threads sum rounds differently each time.
"""

from __future__ import annotations

import os
import threading
from concurrent.futures import ThreadPoolExecutor
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

    Called by such a function, it goes through its items one after the other: the processors have enough to do.
    """
    if getattr(_thread, "is_one_of_many", False):
        return [function(item) for item in items]
    with ThreadPoolExecutor(len(os.sched_getaffinity(0)), initializer=_join_in) as pool:
        return list(pool.map(function, items))


def _join_in() -> None:
    _thread.is_one_of_many = True
