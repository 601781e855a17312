"""A service's load beside the same without."""

from __future__ import annotations

import socket

from benchmarks.report import Figure
from benchmarks.service import compared
from benchmarks.service_load import Manager, Poller


def test_each_figure_keeps_its_goal_and_gets_its_ratio() -> None:
    serviced = [Figure("late p50: 3 µs", 1.1, "×", 1.2, peer="cyclictest"), Figure("rows dropped", 2.0, "rows", 0.0)]
    alone = [Figure("late p50: 2 µs", 1.0, "×", 1.2, peer="cyclictest"), Figure("rows dropped", 0.0, "rows", 0.0)]
    late, ratio, dropped = compared("x", serviced, alone)
    assert (late.value, late.goal, late.peer, late.met) == (1.1, 1.2, "cyclictest", True)
    assert (ratio.value, ratio.goal) == (1.1, None)
    assert (dropped.value, dropped.met) == (2.0, False)


def test_a_manager_counts_keep_alives_only() -> None:
    with Manager(watchdog_s=2.0) as manager:
        assert manager.environment["WATCHDOG_USEC"] == "2000000"
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as daemon:
            for message in (b"READY=1", b"WATCHDOG=1", b"STATUS=off", b"WATCHDOG=1"):
                daemon.sendto(message, manager.environment["NOTIFY_SOCKET"])
    assert manager.fed == 2
    assert 0 < manager.longest_hunger_s < 1.0


def test_a_poller_ends_with_the_first_error() -> None:
    answers = iter([1, 2])

    def ask() -> int:
        return next(answers)

    with Poller(ask, 0.001) as poller:
        poller._thread.join(5.0)
    assert poller.answered == 2
    assert isinstance(poller.failed, StopIteration)
