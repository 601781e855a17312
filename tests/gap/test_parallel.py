"""Threads: many for the filter, one for linear algebra."""

from __future__ import annotations

import os

from threadpoolctl import threadpool_info, threadpool_limits

from hapticd.gap.parallel import each, one_blas_thread


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
    assert each(lambda item: item**2, range(50)) == [item**2 for item in range(50)]
