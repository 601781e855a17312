"""Statistics of the last seconds: the difference of two looks at counters that only count up."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest

from hapticd.service.recent import RecentTiming
from hapticd.servo import atomics, pace
from hapticd.servo.core import ServoCore
from hapticd.servo.timing import BUCKETS, bucket_edges


class Counters:
    """A loop's counters, without the loop."""

    def __init__(self) -> None:
        self.words = dict.fromkeys(range(atomics.SIZE), 0)
        self.late_histogram = np.zeros(BUCKETS, np.int64)
        self.exec_histogram = np.zeros(BUCKETS, np.int64)

    def load(self, word: int) -> int:
        return self.words[word]

    def tick(self, ticks: int, late_us: float, missed: int = 0, exchanges: int = 0) -> None:
        self.words[atomics.TICKS] += ticks
        self.words[atomics.MISSED_PERIODS] += missed
        self.words[atomics.MISSED_EXCHANGES] += exchanges
        self.words[atomics.LATE_MAX_NS] = max(self.words[atomics.LATE_MAX_NS], round(1e3 * late_us))
        self.words[atomics.EXEC_MAX_NS] = max(self.words[atomics.EXEC_MAX_NS], 5000)
        for histogram, value in ((self.late_histogram, late_us), (self.exec_histogram, 5.0)):
            histogram[int(np.searchsorted(bucket_edges(), 1e3 * value, side="right")) - 1] += ticks


def windows(recent: RecentTiming, core: Counters, now_s: float) -> dict[str, Any]:
    return recent.statistics(cast("ServoCore", core), now_s, 1000.0)


def played(seconds: int, recent: RecentTiming, core: Counters, **worse: Any) -> None:
    """So many seconds at 1 kHz, looked at as often as the supervisor does; the first one with something worse."""
    for second in range(seconds):
        for beat in range(20):
            recent.look(cast("ServoCore", core), second + 0.05 * beat)
        core.tick(1000, **(worse if second == 0 and worse else {"late_us": 20.0}))


def test_what_is_long_ago_is_not_in_the_last_seconds() -> None:
    recent, core = RecentTiming(), Counters()
    played(40, recent, core, late_us=900.0, missed=3, exchanges=2)
    found = windows(recent, core, 40.0)
    ten, sixty = found["last_10_s"], found["last_60_s"]
    assert (ten["ticks"], ten["missed"], ten["exchanges_missed"]) == (10_000, 0, 0)
    assert ten["wake_us"]["max"] == pytest.approx(20.0, rel=0.04)
    assert (sixty["ticks"], sixty["missed"], sixty["exchanges_missed"]) == (40_000, 3, 2)
    assert sixty["wake_us"]["max"] == pytest.approx(900.0, rel=0.04)
    assert (ten["span_s"], sixty["span_s"]) == (10.0, 40.0)
    assert ten["verdict"] == "keeps up: lateness and execution take 2.5 % of a period at p99.9"
    assert sixty["verdict"].startswith("does not keep up: 3 periods missed and 2 exchanges missed; ")


def test_a_minute_is_all_that_is_kept() -> None:
    recent, core = RecentTiming(), Counters()
    played(200, recent, core, late_us=900.0, missed=3)
    assert windows(recent, core, 200.0)["last_60_s"]["missed"] == 0
    assert windows(recent, core, 200.0)["last_60_s"]["ticks"] == 60_000


def test_before_the_first_look_and_with_another_rig_there_is_nothing_to_say() -> None:
    recent, core, other = RecentTiming(), Counters(), Counters()
    assert windows(recent, core, 0.0)["last_10_s"]["verdict"] == "no tick yet"
    played(5, recent, core)
    assert windows(recent, other, 5.0)["last_10_s"]["ticks"] == 0
    other.tick(40, 20.0)
    assert windows(recent, other, 5.0)["last_10_s"]["ticks"] == 40
    recent.look(cast("ServoCore", other), 5.0)
    other.tick(60, 20.0)
    assert windows(recent, other, 6.0)["last_60_s"]["ticks"] == 100


def test_nothing_recent_is_more_than_there_was_since_the_start() -> None:
    class Ticking(Counters):
        """A loop that goes on while it is looked at."""

        def load(self, word: int) -> int:
            self.tick(7, 20.0, missed=1, exchanges=1)
            return super().load(word)

    recent, core = RecentTiming(), Ticking()
    recent.look(cast("ServoCore", core), 0.0)
    found = windows(recent, core, 0.3)
    for name in ("ticks", "missed", "exchanges_missed"):
        assert found[name] == found["last_10_s"][name] == found["last_60_s"][name] > 0
    assert found["wake_us"] == found["last_10_s"]["wake_us"] == {"p50": 20.0, "p99": 20.0, "p999": 20.0, "max": 20.0}


def test_without_margin_is_said() -> None:
    slow = {"p50": 10.0, "p99": 300.0, "p999": 400.0, "max": 500.0}
    timing = {"missed": 0, "exchanges_missed": 0, "wake_us": slow, "exec_us": slow}
    assert pace.verdict(timing, 1000.0).startswith("keeps up without margin: lateness and execution take 80 %")
    assert pace.verdict(timing, 500.0).startswith("keeps up: ")
