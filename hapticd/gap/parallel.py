"""Independent runs of the filter beside each other: it holds no lock of Python's, so threads do.

Linear algebra stays on one thread: its matrices are small, and the order in which threads sum rounds differently each time.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, TypeVar, cast

from threadpoolctl import threadpool_limits

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

Given = TypeVar("Given")
Found = TypeVar("Found")
Function = TypeVar("Function", bound="Callable[..., Any]")


def one_blas_thread(function: Function) -> Function:
    """A function during which linear algebra has one thread."""
    return cast("Function", threadpool_limits.wrap(limits=1, user_api="blas")(function))


def each(function: Callable[[Given], Found], items: Iterable[Given]) -> list[Found]:
    """What a function returns for each item, in their order, on all processors that the process may use.

    The function must not call this again: a thread that waits for others takes their place.
    """
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        return list(pool.map(function, items))
