"""What the stability guard costs: a judgement, which the daemon makes on a request, and a tick while judgements are made.

Judged are configurations that nobody has seen (`tests.stability.claims`), so that no answer is remembered.

The guard runs where requests are answered, never on the servo thread: a tick must cost the same while it works. Blocks with
a thread that judges without a pause and blocks without one alternate; the figure is the ratio of the median blocks. All
times are processor time of the thread that is timed, so that a busy machine changes them little.
"""

from __future__ import annotations

import math
import statistics
import threading
import time
from collections.abc import Callable

from benchmarks.report import Figure, progress
from benchmarks.tick import Case
from hapticd import check
from hapticd.config import parse_config
from hapticd.stability.guard import judge
from hapticd.stability.numbers import loop_from_config
from hapticd.stability.sampled_loop import run_loops
from hapticd.stability.starts import starts_of
from hapticd.stability.whole_loop import record_of
from tests.stability.claims import CLASSES, Question, draw

GOAL_JUDGEMENT_MS = 100.0
"""A person who sets a key does not notice it."""
GOAL_CHECK_S = 1.0
GOAL_RATIO = 1.3
_SEED = 51_100
REFUSED = parse_config({"encoder": {"decimation": 217}, "spring": {"stiffness": 0.5}}, "benchmark")


def _questions(count: int) -> list[Question]:
    """Fresh ones, as many of each class as of the others: nothing about them is remembered."""
    each = [draw(kind, -(-count // len(CLASSES)), _SEED) for kind in CLASSES]
    return [question for together in zip(*each, strict=True) for question in together][:count]


def _p99(values: list[float]) -> float:
    return statistics.quantiles(values, n=100, method="inclusive")[98]


def _judgements(count: int) -> Figure:
    """Processor time of each of so many judgements, of configurations never seen."""
    took, refused = [], 0
    for question in _questions(count + 1):  # the first one loads what all of them need
        begin = time.thread_time_ns()
        found = judge(question.config, 0.0, **question.asked)
        took.append((time.thread_time_ns() - begin) * 1e-6)
        refused += found.verdict == "refused"
    took = took[1:]
    details = {"median_ms": statistics.median(took), "slowest_ms": max(took), "judgements": count, "refused": refused}
    return Figure("one judgement of a fresh config, p99", _p99(took), "ms", GOAL_JUDGEMENT_MS, details=details)


def _checks(count: int) -> list[Figure]:
    """What ``hapticd check`` takes for fresh configurations, and what one exact period takes in it."""
    took, per_period = [], []
    for question in _questions(count):
        begin = time.perf_counter()
        found = check(question.config, **question.asked)
        str(found)
        took.append(time.perf_counter() - begin)
    for question in _questions(count):
        loop = loop_from_config(question.config)
        begin_ns = time.thread_time_ns()
        runs = run_loops(starts_of(record_of(question.config, loop), None, 30.0, math.inf, 0, 256), 2_000)
        per_period.append((time.thread_time_ns() - begin_ns) / runs["periods"].sum())
    details = {"median_s": statistics.median(took), "slowest_s": max(took), "checks": count}
    return [
        Figure("one check of a fresh config, p99", _p99(took), "s", GOAL_CHECK_S, details=details),
        Figure("one exact period of it, median", statistics.median(per_period), "ns"),
    ]


def _while_judging(measure: Callable[[], float]) -> float:
    """What ``measure`` finds while another thread judges without a pause."""
    ending = threading.Event()

    def work() -> None:
        while not ending.is_set():
            judge(REFUSED, 0.0)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        return measure()
    finally:
        ending.set()
        thread.join()


def measure(quick: bool) -> list[Figure]:
    """What a judgement and a check take, and the cost of a tick beside a judgement over that without."""
    count = 20 if quick else 200
    figures = [_judgements(70 if quick else 700), *_checks(21 if quick else 210)]
    case = Case({}, time.thread_time_ns)
    alone, beside = [], []
    for _ in range(count):
        alone.append(case.block_ns())
        beside.append(_while_judging(case.block_ns))
    progress(f"{count} blocks of ticks without and with a thread that judges")
    ratio = statistics.median(beside) / statistics.median(alone)
    details = {"alone_ns": statistics.median(alone), "beside_ns": statistics.median(beside), "blocks": count}
    figures.append(Figure("one tick beside judgements", ratio, "×", GOAL_RATIO, peer="without", details=details))
    return figures
