"""What the soak judges by: every period of the tick column, and memory after the first minute."""

from __future__ import annotations

import socket
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.report import BenchmarkError
from benchmarks.service_load import Manager, Poller
from benchmarks.soak import Totals, accounts, growth_mb
from hapticd.record.schema import FLAG_MISSED_PERIOD, FLAG_RUNNING

# The daemon had done ticks 0 to 9 and missed none when the recording began; then it missed 3 of 13 periods.
TICK = np.array([10, 11, 12, 14, 15, 16, 17, 20, 21, 22])
FLAGS = np.array([1, 1, 1, 1 | FLAG_MISSED_PERIOD, 1, 1, 1, 1 | FLAG_MISSED_PERIOD, 1, 1])
TOTALS = Totals(ticks=20, missed=3, rows=10, dropped=0)
FLAWS = ("unaccounted", "unmarked", "backwards", "rows_differ")


def flaws(tick: np.ndarray = TICK, flags: np.ndarray = FLAGS, totals: Totals = TOTALS) -> set[str]:
    found = accounts(tick, flags, totals)
    return {name for name in FLAWS if found[name]}


def test_rows_and_missed_make_the_span() -> None:
    found = accounts(TICK, FLAGS, TOTALS)
    assert (found["periods"], found["missed"], found["missed_in_a_row"]) == (13, 3, 2)
    assert flaws() == set()


def test_a_missed_period_that_was_not_counted() -> None:
    assert flaws(totals=replace(TOTALS, missed=2)) == {"unaccounted"}


def test_one_counted_twice() -> None:
    assert flaws(totals=replace(TOTALS, missed=4)) == {"unaccounted"}


def test_a_gap_that_the_row_after_it_does_not_mark() -> None:
    assert flaws(flags=np.full(len(TICK), FLAG_RUNNING)) == {"unmarked"}


def test_a_row_that_is_not_on_file() -> None:
    keep = np.arange(len(TICK)) != 5
    assert flaws(TICK[keep], FLAGS[keep]) == {"unmarked", "rows_differ"}


def test_a_tick_that_comes_twice() -> None:
    tick = TICK.copy()
    tick[1] = 10
    assert "backwards" in flaws(tick)


def test_the_daemons_last_output() -> None:
    words = (
        "ticks       20, missed periods 3, missed exchanges 0\n"
        "late        p50 1.0  p99 2.0  p99.9 3.0  max 4.0 µs\n"
        "execution   -\n"
        "recorded    10 rows, 0 dropped\n"
    )
    assert Totals.of("banner\n" + words) == TOTALS
    with pytest.raises(BenchmarkError, match="Killed"):
        Totals.of("Killed")


def test_growth_counts_from_the_end_of_the_first_minute() -> None:
    early = [(0.0, 100_000_000), (59.0, 140_000_000)]
    assert np.isnan(growth_mb(early))
    assert growth_mb([*early, (60.0, 150_000_000), (61.0, 152_000_000), (62.0, 151_000_000)]) == pytest.approx(2.0)


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
