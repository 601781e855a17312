"""Which of the daemon's own activities makes the servo thread late: each is switched off by itself, in one interleaved run.

The conditions are those of `benchmarks.lateness`: a Python thread of the daemon's that computes without end, a client that
asks without end. Every round runs each arm once, beginning with another one each time, and so does cyclictest, beside all of
it and beside none of it while the servo loop idles at 10 Hz. An arm is judged by the median over the rounds of its quantile
over that of the arm with everything on, so that what the machine does meanwhile cancels. Timer slack is no arm: the kernel
gives none to a thread of SCHED_FIFO (prctl(2)).

``python -m benchmarks.lateness_causes``: twenty minutes; ``--quick``: three, of which p99.9 is a handful of ticks.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks import cyclictest
from benchmarks.daemon import MeasuredDaemon, quantile_us
from benchmarks.hammer import Hammer
from benchmarks.lateness import GOAL, IDLE_RATE_HZ, PRIORITY, servo_block
from benchmarks.report import Figure, progress, run_alone

if TYPE_CHECKING:
    from numpy.typing import NDArray

ALL = "all on"
NONE = "all off"
SELDOM_S = 1.0
"""Between two wake-ups of what cannot be switched off: 20 to 50 times as long as by itself."""
ON: dict[str, Any] = {"readers": True, "busy": True, "recorder_s": 0.02, "beat_s": 0.05, "gc": True}
OFF: dict[str, Any] = {"readers": False, "busy": False, "recorder_s": SELDOM_S, "beat_s": SELDOM_S, "gc": False}
NAMES = {
    "readers": "no status readers",
    "busy": "no busy Python thread",
    "recorder_s": "recorder wakes once a second",
    "beat_s": "heartbeat once a second",
    "gc": "no garbage collection",
}
ARMS = {ALL: ON, **{name: {**ON, key: OFF[key]} for key, name in NAMES.items()}, NONE: OFF}
PEERS = {f"cyclictest beside {ALL}": ON, f"cyclictest beside {NONE}": OFF}
QUANTILES = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999}


def measure(quick: bool) -> list[Figure]:
    """Ratios at p50, p99, p99.9, and the servo thread's page faults and preemptions in each arm."""
    cyclictest.require()
    rounds, seconds = (3, 4) if quick else (12, 10)
    blocks: dict[str, list[NDArray[np.float64]]] = {name: [] for name in (*ARMS, *PEERS)}
    disturbed: dict[str, list[NDArray[np.int64]]] = {name: [] for name in ARMS}
    settings = {
        "servo.rate_hz": str(IDLE_RATE_HZ),
        "servo.priority": str(PRIORITY),
        "safety.heartbeat_timeout_s": str(10 * SELDOM_S),
    }
    with MeasuredDaemon(settings, busy=True) as daemon, Hammer(daemon.socket, processes=1, threads=1) as hammer:
        servo_block(daemon, 1)  # a daemon's first recording loads its writer
        order = list(blocks)
        for turn in range(rounds):
            for name in order[turn % len(order) :] + order[: turn % len(order)]:
                switches = {**ARMS, **PEERS}[name]
                hammer.pause(not switches["readers"])
                daemon.switch(**{key: value for key, value in switches.items() if key != "readers"})
                time.sleep(SELDOM_S)  # the sleep that was begun before ends
                if name in PEERS:
                    blocks[name].append(cyclictest.lateness_ns(seconds, priority=PRIORITY))
                else:
                    before = _disturbances(daemon)
                    blocks[name].append(servo_block(daemon, seconds)[0])
                    disturbed[name].append(_disturbances(daemon) - before)
            progress(
                f"round {turn + 1} of {rounds}: "
                + ", ".join(f"{n} {quantile_us(b[-1], 0.999):.0f}" for n, b in blocks.items())
            )
        daemon.require_healthy()
    return _figures(blocks, disturbed)


def _figures(
    blocks: dict[str, list[NDArray[np.float64]]], disturbed: dict[str, list[NDArray[np.int64]]]
) -> list[Figure]:
    figures = []
    by_round = {
        name: {q: np.array([quantile_us(block, at) for block in found]) for q, at in QUANTILES.items()}
        for name, found in blocks.items()
    }
    for arm in ARMS:
        peer = next((name for name, switches in PEERS.items() if switches is ARMS[arm]), None)
        for against in dict.fromkeys(filter(None, (peer, None if arm == ALL else ALL))):
            for q in QUANTILES:
                ours, theirs = by_round[arm][q], by_round[against][q]
                shown = f"{arm}, late {q}: {np.median(ours):.1f} µs, {against} {np.median(theirs):.1f} µs"
                goal = GOAL if against in PEERS and arm == ALL else None
                details = {"ours_us": ours.tolist(), "theirs_us": theirs.tolist()}
                figures.append(Figure(shown, float(np.median(ours / theirs)), "×", goal, peer=against, details=details))
        faults, preempted = (int(count) for count in np.sum(disturbed[arm], axis=0))
        figures.append(
            Figure(f"{arm}, page faults of the servo thread; preempted {preempted} times", float(faults), "")
        )
    return figures


def _disturbances(daemon: MeasuredDaemon) -> NDArray[np.int64]:
    """Page faults of the servo thread so far, and how often another took its processor (proc(5))."""
    task = Path(f"/proc/{daemon.pid}/task/{daemon.thread_id('hapticd-servo')}")
    fields = (task / "stat").read_text().rpartition(")")[2].split()
    switches = (task / "status").read_text().rpartition("nonvoluntary_ctxt_switches:")[2]
    return np.array([int(fields[7]) + int(fields[9]), int(switches)])


def main(argv: list[str] | None = None) -> int:
    """Run this study alone."""
    return run_alone("lateness_causes", measure, argv)


if __name__ == "__main__":
    sys.exit(main())
