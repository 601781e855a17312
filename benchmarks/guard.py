"""What the stability guard costs: a judgement, which the daemon makes on a request, and a tick while judgements are made.

The guard runs where requests are answered, never on the servo thread: a tick must cost the same while it works. Blocks with
a thread that judges without a pause and blocks without one alternate; the figure is the ratio of the median blocks. All
times are processor time of the thread that is timed, so that a busy machine changes them little.
"""

from __future__ import annotations

import statistics
import sys
import threading
import time
from collections.abc import Callable

from benchmarks.report import BenchmarkError, Figure, progress, run_alone
from benchmarks.tick import Case
from hapticd.config import Config, parse_config
from hapticd.stability.guard import Verdict, judge

GOAL_JUDGEMENT_MS = 100.0
"""A person who sets a key does not notice it."""
GOAL_RATIO = 1.3
ADMITTED = parse_config({}, "benchmark")
REFUSED = parse_config({"encoder": {"decimation": 217}, "spring": {"stiffness": 0.5}}, "benchmark")


def _judgement_ms(config: Config, expected: Verdict, count: int) -> list[float]:
    """Each of so many judgements, ms."""
    took = []
    for _ in range(count + 1):  # the first one loads what all of them need
        begin = time.thread_time_ns()
        found = judge(config, 0.0)
        took.append((time.thread_time_ns() - begin) * 1e-6)
        if found.verdict != expected:
            raise BenchmarkError(f"the guard says {found.verdict} of a spring that is to be {expected}")
    return took[1:]


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
    """Median time of a judgement, and the cost of a tick beside one over that without."""
    count = 20 if quick else 200
    figures = []
    for name, config, expected in (("admitted", ADMITTED, "admitted"), ("refused, with advice", REFUSED, "refused")):
        took = _judgement_ms(config, expected, count)
        details = {"slowest_ms": max(took), "judgements": count}
        figures.append(
            Figure(f"one judgement, {name}", statistics.median(took), "ms", GOAL_JUDGEMENT_MS, details=details)
        )
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


def main(argv: list[str] | None = None) -> int:
    """Run this benchmark alone."""
    return run_alone("guard", measure, argv)


if __name__ == "__main__":
    sys.exit(main())
