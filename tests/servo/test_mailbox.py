"""Parameters arrive whole, between two ticks, and never stop the loop."""

from __future__ import annotations

import threading

import numpy as np

from hapticd.servo import atomics
from hapticd.servo import layout as w
from hapticd.servo.core import Request, ServoCore, parameters
from hapticd.servo.loop import take_parameters
from tests.servo.scripted import config


def bare_core() -> ServoCore:
    from drivers.null import NullDriver

    driver = NullDriver(config())
    driver.open()
    return ServoCore(driver, ring_rows=1 << 19, excitation_rows=1)


def test_parameter_sets_arrive_whole_under_fire() -> None:
    """Two sets, published as fast as Python can; each row must show the force of one of them, never a mixture."""
    core = bare_core()
    first = parameters(config(), Request(state=w.RUNNING), safety=False)
    second = first.copy()
    first["force_per_tick"], first["bias"] = 1.0, 3.0
    second["force_per_tick"], second["bias"] = 10.0, 5.0
    core.publish(first)
    core.begin(0, w.RUNNING)
    runner = threading.Thread(target=lambda: core.run(real_time=False, ticks=400_000))
    runner.start()
    published = 0
    while runner.is_alive():
        core.publish(second if published % 2 == 0 else first)
        published += 1
    runner.join()
    forces = set(core.drain()["force_command"])
    assert forces <= {-3.0, -50.0}
    assert published > 100
    assert core.load(atomics.TICKS) == 400_000


def test_torn_read_keeps_the_old_set_and_tries_again() -> None:
    core = bare_core()
    params = parameters(config(), Request())
    core.publish(params)
    core.begin(0)
    before = core.params.copy()
    # A writer that has already begun the set after next: the copy cannot be trusted.
    changed = params.copy()
    changed["force_per_tick"] = 99.0
    core.publish(changed)
    core.publish(params)
    core.publish(changed)
    assert take_parameters(core.memory[0], core.shared)
    assert core.params["force_per_tick"] == 99.0
    assert not take_parameters(core.memory[0], core.shared)
    assert before["force_per_tick"] != 99.0


def test_full_ring_drops_and_counts_but_does_not_stop() -> None:
    from drivers.null import NullDriver

    driver = NullDriver(config())
    driver.open()
    core = ServoCore(driver, ring_rows=64, excitation_rows=1)
    core.publish(parameters(config(), Request()))
    core.begin(0)
    core.run(real_time=False, ticks=100)
    rows = core.drain()
    assert len(rows) == 64
    assert list(rows["tick"]) == list(range(64))
    assert core.dropped() == 36
    core.run(real_time=False, ticks=3)
    assert list(core.drain()["tick"]) == [100, 101, 102]


def test_a_backlog_comes_in_portions_and_ends_where_it_ended_when_asked() -> None:
    from drivers.null import NullDriver

    driver = NullDriver(config())
    driver.open()
    core = ServoCore(driver, ring_rows=64, excitation_rows=1)
    assert [len(rows) for rows in core.drain_batches(20)] == [0]
    core.publish(parameters(config(), Request()))
    core.begin(0)
    core.run(real_time=False, ticks=50)
    assert [len(rows) for rows in core.drain_batches(20)] == [20, 20, 10]
    core.run(real_time=False, ticks=40)
    batches = core.drain_batches(20)
    taken = [list(next(batches)["tick"])]
    core.run(real_time=False, ticks=7)
    taken += [list(rows["tick"]) for rows in batches]
    assert [len(ticks) for ticks in taken] == [14, 20, 6]  # the ring's end lies after 64 rows
    assert [tick for ticks in taken for tick in ticks] == list(range(50, 90))
    assert list(core.drain()["tick"]) == list(range(90, 97))
    assert core.dropped() == 0


def test_timing_is_empty_before_the_first_tick() -> None:
    timing = bare_core().timing()
    assert timing["ticks"] == 0
    assert timing["wake_us"]["p50"] is None
    assert np.isfinite(timing["missed"])
