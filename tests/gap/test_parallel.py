"""Threads: many for the filter, one for linear algebra."""

from __future__ import annotations

import os
import threading
import time

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from hapticd.gap.parallel import check_cancelled, one_blas_thread, parallel_map


def _blas_threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_linear_algebra_has_one_thread_while_it_matters() -> None:
    with threadpool_limits(limits=2, user_api="blas"):
        before = _blas_threads()
        assert one_blas_thread(_blas_threads)() == {1}
        assert _blas_threads() == before
    if (os.cpu_count() or 1) > 1:
        assert before == {2}


def test_each_keeps_the_order() -> None:
    assert parallel_map(lambda item: item**2, range(50)) == [item**2 for item in range(50)]


def test_each_within_each_stays_on_its_thread() -> None:
    def inner(item: int) -> list[tuple[int, int]]:
        return parallel_map(lambda part: (item + part, threading.get_ident()), range(4))

    for number, found in enumerate(parallel_map(inner, range(8))):
        assert [value for value, _ in found] == [number + part for part in range(4)]
        assert len({thread for _, thread in found}) == 1


def test_an_error_ends_what_the_others_are_at() -> None:
    begun = threading.Event()
    done: list[int] = []

    def step(part: int) -> None:
        check_cancelled()
        time.sleep(0.01)
        done.append(part)

    def work(number: int) -> list[None]:
        if number == 0:
            assert begun.wait(10.0)
            raise KeyboardInterrupt
        begun.set()
        return parallel_map(step, range(500))

    if len(os.sched_getaffinity(0)) > 1:
        with pytest.raises(KeyboardInterrupt):
            parallel_map(work, range(2))
        assert 0 < len(done) < 500
