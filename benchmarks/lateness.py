"""How late the servo thread wakes, against ``cyclictest`` at the same priority and period, in one interleaved run.

The daemon and cyclictest take turns in short blocks, each going first in every other pair, while one Python thread of
the daemon's own process computes without end and an API client hammers the daemon with queries: in cyclictest's blocks
too, when the servo loop merely idles along at 10 Hz. So both see the same machine, and a slow drift of it cancels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks import cyclictest
from benchmarks.daemon import MeasuredDaemon, lateness_ns, quantile_us
from benchmarks.hammer import Hammer
from benchmarks.report import Figure, progress

if TYPE_CHECKING:
    from numpy.typing import NDArray

RATE_HZ = 1000.0
PRIORITY = 80
IDLE_RATE_HZ = 10.0
GOAL = 1.2
QUANTILES = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999, "max": 1.0}
WITH_GOAL = ("p50", "p99")


def servo_block(daemon: MeasuredDaemon, seconds: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """One block of the servo loop: how late each tick woke and how long it ran, ns."""
    daemon.set_rate(RATE_HZ)
    run = daemon.record(seconds)
    daemon.set_rate(IDLE_RATE_HZ)
    return lateness_ns(run, RATE_HZ), np.asarray(run.columns["exec_ns"], dtype=np.float64)


def measure(quick: bool) -> list[Figure]:
    """Ratios of the pooled quantiles, and the time a tick runs in the same blocks."""
    cyclictest.require()
    pairs, seconds = (2, 1) if quick else (6, 10)
    servo: list[NDArray[np.float64]] = []
    peer: list[NDArray[np.float64]] = []
    ran: list[NDArray[np.float64]] = []
    settings = {"servo.rate_hz": str(IDLE_RATE_HZ), "servo.priority": str(PRIORITY)}
    with MeasuredDaemon(settings, busy=True) as daemon, Hammer(daemon.socket, processes=1, threads=1) as hammer:
        servo_block(daemon, 1)  # a daemon's first recording loads its writer: see the benchmark `recorder`
        for pair in range(pairs):
            for is_servo in (pair % 2 == 0, pair % 2 == 1):
                if is_servo:
                    late, spent = servo_block(daemon, seconds)
                    servo.append(late)
                    ran.append(spent)
                else:
                    peer.append(cyclictest.lateness_ns(seconds, priority=PRIORITY))
            text = ", ".join(
                f"{name} {quantile_us(servo[-1], q):.1f} : {quantile_us(peer[-1], q):.1f}"
                for name, q in QUANTILES.items()
            )
            progress(f"pair {pair + 1} of {pairs}, hapticd : cyclictest, µs late: {text}")
        status = daemon.require_healthy()

    all_servo, all_peer, all_ran = np.concatenate(servo), np.concatenate(peer), np.concatenate(ran)
    figures = []
    for name, q in QUANTILES.items():
        ours, theirs = quantile_us(all_servo, q), quantile_us(all_peer, q)
        details = {
            "hapticd_us": ours,
            "cyclictest_us": theirs,
            "pairs_us": [
                (quantile_us(mine, q), quantile_us(other, q)) for mine, other in zip(servo, peer, strict=True)
            ],
            "samples": (all_servo.size, all_peer.size),
        }
        shown = f"late {name}: {ours:.1f} µs, cyclictest {theirs:.1f} µs"
        goal = GOAL if name in WITH_GOAL else None
        figures.append(Figure(shown, ours / theirs, "×", goal, peer=cyclictest.PEER, details=details))
    executed = {name: quantile_us(all_ran, q) for name, q in QUANTILES.items()}
    served = {"served": hammer.served, "missed": status["timing"]["missed"], **executed}
    figures.append(Figure("a tick runs, read to record, p50", executed["p50"], "µs", details=served))
    return figures
