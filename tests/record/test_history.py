from __future__ import annotations

import numpy as np
import pytest
from record_samples import make_rows

from hapticd.record.history import History
from hapticd.record.schema import ROW


def test_an_empty_history_gives_no_rows() -> None:
    assert History().snapshot().shape == (0,)


@pytest.mark.parametrize(("rate_hz", "pull"), [(200.0, 4), (1000.0, 20), (20_000.0, 400), (20_000.0, 50_000)])
def test_holds_exactly_the_last_ten_seconds_in_bounded_memory(rate_hz: float, pull: int) -> None:
    history = History()
    total = int(25 * rate_hz)
    for first in range(0, total, pull):
        history.add(make_rows(min(pull, total - first), first, rate_hz), rate_hz)
        assert history.rows <= 10 * rate_hz + 1024
    kept = history.snapshot()
    assert np.array_equal(kept["tick"], np.arange(total - kept.size, total))
    assert abs(kept.size - 10 * rate_hz) <= 1
    assert history.nbytes == (10 * rate_hz + 1024) * ROW.itemsize


def test_memory_is_all_there_with_the_first_row() -> None:
    history = History()
    history.add(make_rows(1), 1000.0)
    first = history.nbytes
    for begin in range(1, 30_000, 37):
        history.add(make_rows(37, begin), 1000.0)
    assert history.nbytes == first


def test_a_live_rate_change_keeps_ten_seconds_across_it() -> None:
    history, time_s, tick = History(), 0.0, 0
    for rate_hz, seconds in [(1000.0, 8.0), (20_000.0, 4.0), (500.0, 3.0), (20_000.0, 2.0)]:
        for _ in range(int(seconds / 0.02)):
            rows = make_rows(int(rate_hz * 0.02), tick)
            rows["time_s"] = time_s + np.arange(1, rows.size + 1) / rate_hz
            time_s, tick = float(rows["time_s"][-1]), tick + rows.size
            history.add(rows, rate_hz)
    kept = history.snapshot()
    assert 9.99 < kept["time_s"][-1] - kept["time_s"][0] < 10.0
    assert np.all(np.diff(kept["tick"]) == 1)
    assert history.rows <= 10 * 20_000 + 1024


def test_a_stopped_clock_cannot_grow_it() -> None:
    history = History()
    rows = make_rows(1000)
    rows["time_s"] = 5.0
    for _ in range(100):
        history.add(rows, 1000.0)
    assert history.rows <= 10 * 1000 + 1024


def test_time_that_goes_back_begins_anew() -> None:
    history = History()
    history.add(make_rows(100, 5000), 1000.0)
    history.add(make_rows(50, 0), 1000.0)
    assert np.array_equal(history.snapshot()["tick"], np.arange(50))


def test_rows_are_copied_because_the_ring_reuses_them() -> None:
    history, rows = History(), make_rows(10)
    history.add(rows, 1000.0)
    rows["tick"] = -1
    assert np.array_equal(history.snapshot()["tick"], np.arange(10))
