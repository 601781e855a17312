"""What the loaded soak goes by: its schedule, which episode explains a fault, the account of many recordings, growth."""

from __future__ import annotations

import math
import os
import random
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from hapticd.config import LIVE_KEYS, apply_settings
from hapticd.record.schema import FLAG_MISSED_PERIOD
from tests.soak.judge import Sample, Segment, Totals, balance, growth, kept_rows
from tests.soak.machine import Others, busy_s
from tests.soak.rigs import DRIVERS, config_of
from tests.soak.schedule import (
    AFTERMATH_S,
    BURSTS,
    CALM_S,
    KINDS,
    Episode,
    each_came_once_s,
    explaining,
    schedule,
)
from tests.soak.troubles import fresh_settings

FLAWS = ("unaccounted", "unmarked", "backwards", "rows_differ")


def segment(ticks: list[int], claimed: int | None = None) -> Segment:
    tick = np.array(ticks)
    flags = np.concatenate([[1], np.where(np.diff(tick) > 1, 1 | FLAG_MISSED_PERIOD, 1)])
    return Segment.of(tick, flags, len(tick) if claimed is None else claimed)


# Ticks 0 to 4 came before; between the recordings are 9 to 11, of which one was missed; 14 and 15 were missed on record.
SEGMENTS = [segment([5, 6, 7, 8]), segment([12, 13, 16, 17])]
TOTALS = Totals(ticks=15, missed=3, rows=8, dropped=0)


def flaws(segments: list[Segment] = SEGMENTS, totals: Totals = TOTALS) -> set[str]:
    found = balance(segments, totals)
    return {name for name in FLAWS if found[name]}


def test_recordings_and_what_lies_between_make_the_whole() -> None:
    found = balance(SEGMENTS, TOTALS)
    assert {name: found[name] for name in ("periods", "rows", "missed", "between", "missed_in_a_row")} == {
        "periods": 18,
        "rows": 8,
        "missed": 2,
        "between": 8,
        "missed_in_a_row": 2,
    }
    assert flaws() == set()


def test_a_period_that_was_counted_neither_as_done_nor_as_missed() -> None:
    assert flaws(totals=replace(TOTALS, missed=2)) == {"unaccounted"}


def test_a_sum_that_is_right_but_fewer_missed_than_the_recordings_show() -> None:
    assert flaws(totals=replace(TOTALS, ticks=17, missed=1)) == {"unaccounted"}


def test_more_missed_than_have_room_between_the_recordings() -> None:
    assert flaws(totals=replace(TOTALS, ticks=7, missed=11)) == {"unaccounted"}


def test_a_row_that_the_daemon_claims_and_the_file_has_not() -> None:
    assert flaws([segment([5, 6, 7, 8], claimed=5), SEGMENTS[1]]) == {"rows_differ"}


def test_recordings_that_overlap() -> None:
    assert "backwards" in flaws([SEGMENTS[0], segment([8, 13, 16, 17])])


def test_a_gap_that_is_not_marked() -> None:
    tick = np.array([12, 13, 16, 17])
    assert flaws([SEGMENTS[0], Segment.of(tick, np.ones(4, int), 4)]) == {"unmarked"}


def test_the_daemons_last_output() -> None:
    words = (
        "banner\n"
        "ticks       15, missed periods 3, missed exchanges 0\n"
        "late        p50 1.0  p99 2.0  p99.9 3.0  max 4.0 µs\n"
        "execution   -\n"
        "recorded    8 rows, 0 dropped\n"
    )
    assert Totals.of(words) == TOTALS
    with pytest.raises(AssertionError, match="Killed"):
        Totals.of("Killed")


def test_what_the_daemon_says_of_a_full_disk() -> None:
    said = "recording stopped: the disk is full (No space left on device); 8123 rows are kept in /x/a.arrow"
    assert kept_rows(said) == 8123
    assert kept_rows(said.replace("the disk is full", "the disk failed")) is None
    assert kept_rows(None) is None


@pytest.mark.parametrize("minutes", [5.0, 120.0, 480.0])
@pytest.mark.parametrize("seed", range(5))
def test_a_schedule_has_every_kind_and_none_in_its_own_way(minutes: float, seed: int) -> None:
    seconds = 60.0 * minutes
    planned = schedule(seconds, seed)
    assert planned == schedule(seconds, seed) != schedule(seconds, seed + 1)
    assert {one.kind for one in planned} == set(KINDS)
    assert all(CALM_S <= one.begin_s <= one.end_s <= seconds - CALM_S for one in planned)
    for kinds in (BURSTS, *((kind,) for kind in KINDS if kind not in BURSTS)):
        turns = [one for one in planned if one.kind in kinds]
        assert all(before.end_s <= after.begin_s for before, after in pairwise(turns))


def test_the_bursts_of_a_long_soak_come_every_two_minutes() -> None:
    bursts = [one for one in schedule(8 * 3600.0, 0) if one.kind in BURSTS]
    assert len(bursts) == pytest.approx(240, abs=1)
    assert all(one.end_s - one.begin_s == pytest.approx(20.0) for one in bursts)


def test_what_explains_a_fault() -> None:
    burst, full = Episode("cpu", 100.0, 120.0), Episode("disk_full", 200.0, 230.0)
    episodes = [burst, full]
    assert explaining("missed_exchanges", 110.0, episodes) is burst
    assert explaining("missed_exchanges", 120.0 + AFTERMATH_S, episodes) is burst
    assert explaining("missed_exchanges", 121.0 + AFTERMATH_S, episodes) is None
    assert explaining("missed_exchanges", 99.0, episodes) is None
    assert explaining("non_finite", 110.0, episodes) is None, "no load makes a command infinite"
    assert explaining("missed_exchanges", 210.0, episodes) is None, "a full disk makes no exchange fail"


def test_a_soak_has_settled_when_each_kind_came_once() -> None:
    planned = [Episode("cpu", 1.0, 2.0), Episode("hdd", 5.0, 9.0), Episode("cpu", 20.0, 30.0), Episode("vm", 6.0, 8.0)]
    assert each_came_once_s(planned) == 9.0
    assert each_came_once_s(schedule(2 * 3600.0, 0)) < 900.0


def test_idle_processors_are_not_busy() -> None:
    ticks = os.sysconf("SC_CLK_TCK")
    assert busy_s("cpu  200 0 100 9000 500 10 20 70 0 0\ncpu0 1 2 3\n") == pytest.approx(400 / ticks)


def test_our_own_work_is_not_that_of_others() -> None:
    others, ours = Others(), Others()
    for one, processes in ((others, []), (ours, [os.getpid()])) * 2:
        one.look(processes)
        spent_s, began_s = time.process_time() + 0.3, time.monotonic()
        while time.process_time() < spent_s:
            pass
    elapsed_s = time.monotonic() - began_s
    assert others.share - ours.share > 0.1 / elapsed_s


def samples(files: list[int], megabytes: list[float]) -> list[Sample]:
    both = zip(files, megabytes, strict=True)
    return [Sample(float(at), round(1e6 * size), count, 9) for at, (count, size) in enumerate(both)]


def test_growth_is_from_the_first_to_the_last_tenth_once_settled() -> None:
    warm = [50.0] * 20 + [80.0] * 100
    episodes = [12 + 3 * (at % 7 == 0) for at in range(120)]
    assert growth(samples(episodes, warm), 20.0) == {"resident": 0.0, "files": 0.0, "threads": 0.0}
    assert growth(samples(episodes, warm), 0.0)["resident"] == pytest.approx(30.0)
    leaking = [count + at // 40 for at, count in enumerate(episodes)]
    assert growth(samples(leaking, warm), 20.0)["files"] == 2.0
    assert math.isnan(growth(samples([1], [1.0]), 0.0)["files"])


@pytest.mark.parametrize("name", DRIVERS)
def test_changed_settings_are_live_and_within_limits(name: str) -> None:
    config, chance = config_of(name, 1000.0), random.Random(0)
    seen: set[str] = set()
    for _ in range(30):
        settings = fresh_settings(chance, config.spring.stiffness)
        seen |= settings.keys()
        apply_settings(config, settings)
    assert seen <= LIVE_KEYS
    assert len(seen) == 3
