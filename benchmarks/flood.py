"""Whether requests reach the servo thread: how late it wakes with and without a flood of them, in alternating blocks.

A flood also loads the machine, which delays anybody's timer. So ``cyclictest`` is measured calm and flooded with queries
too: what the flood does to it is the machine's part, and the rest would be the daemon's. A flood of settings, each of which
hands the loop a whole parameter set, has no such peer: its rate depends on the servo's (see :mod:`benchmarks.hammer`).
"""

from __future__ import annotations

from contextlib import nullcontext
from statistics import median
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from benchmarks import cyclictest
from benchmarks.daemon import MeasuredDaemon
from benchmarks.hammer import Hammer
from benchmarks.lateness import IDLE_RATE_HZ, PRIORITY, servo_block
from benchmarks.report import Figure, progress

if TYPE_CHECKING:
    from numpy.typing import NDArray

PROCESSES = 2
THREADS = 8
Who = Literal["hapticd", "cyclictest"]
Load = Literal["calm", "query", "set"]
PLAN: tuple[tuple[Who, Load], ...] = (
    ("hapticd", "calm"),
    ("cyclictest", "calm"),
    ("hapticd", "query"),
    ("cyclictest", "query"),
    ("hapticd", "set"),
)


def measure(quick: bool) -> list[Figure]:
    """Late p99 (of the median block) with each flood over that without, for the loop and for cyclictest; requests served."""
    cyclictest.require()
    rounds, seconds = (2, 1) if quick else (7, 6)
    blocks: dict[tuple[Who, Load], list[NDArray[np.float64]]] = {}
    served: dict[tuple[Who, Load], int] = {}
    spent_s: dict[tuple[Who, Load], float] = {}
    settings = {"servo.rate_hz": str(IDLE_RATE_HZ), "servo.priority": str(PRIORITY)}
    with MeasuredDaemon(settings) as daemon:

        def block(who: Who, load: Load) -> None:
            key = who, load
            hammer = None if load == "calm" else Hammer(daemon.socket, PROCESSES, THREADS, load)
            with hammer or nullcontext():
                late = servo_block(daemon, seconds)[0] if who == "hapticd" else cyclictest.lateness_ns(seconds)
            blocks.setdefault(key, []).append(late)
            if hammer:
                served[key] = served.get(key, 0) + hammer.served
                spent_s[key] = spent_s.get(key, 0.0) + hammer.seconds
            progress(f"{who}, {load}: late p99 {np.quantile(late, 0.99) / 1e3:.1f} µs")

        servo_block(daemon, 1)  # a daemon's first recording loads its writer: see the benchmark `recorder`
        for turn in range(rounds):
            for who, load in PLAN[:: 1 if turn % 2 == 0 else -1]:
                block(who, load)
        status = daemon.require_healthy()

    per_block = {key: [float(np.quantile(late, 0.99)) / 1e3 for late in found] for key, found in blocks.items()}
    p99 = {key: median(found) for key, found in per_block.items()}
    ratio = {(who, load): p99[who, load] / p99[who, "calm"] for who, load in p99}
    rate = {key: served[key] / spent_s[key] for key in served}
    details: dict[str, Any] = {
        "late_p99_us_of_blocks": {f"{who}, {load}": found for (who, load), found in per_block.items()},
        "requests_per_s": {f"{who}, {load}": value for (who, load), value in rate.items()},
        "missed": status["timing"]["missed"],
        "dropped": status["recorder"]["dropped"],
    }

    def compared(title: str, who: Who, load: Load, details: dict[str, Any]) -> Figure:
        shown = f"{title}: late p99 {p99[who, load]:.1f} µs, calm {p99[who, 'calm']:.1f} µs"
        return Figure(shown, ratio[who, load], "×", peer=f"{who}, calm", details=details)

    apart = ratio["hapticd", "query"] / ratio["cyclictest", "query"]
    return [
        compared("flood of queries", "hapticd", "query", details),
        compared("the same of cyclictest", "cyclictest", "query", {}),
        Figure("the daemon's ratio over the machine's", apart, "×", peer="cyclictest"),
        compared("flood of settings", "hapticd", "set", {}),
        Figure("requests served in all floods", sum(served.values()), ""),
        Figure("queries served", rate["hapticd", "query"], "1/s"),
        Figure("settings served", rate["hapticd", "set"], "1/s"),
    ]
