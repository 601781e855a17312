"""Positions that a device samples with its own clock and holds: the clock is found, and nothing else is taken for one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from hapticd.gap.own_clock import at_the_samples, own_clock

Floats = NDArray[np.float64]
PERIOD, RESOLUTION = 1e-3, 1e-4


def motion(time_s: Floats) -> Floats:
    return np.asarray(0.5 * np.sin(2.0 * np.pi * 1.3 * time_s) + 0.2 * np.sin(2.0 * np.pi * 3.1 * time_s + 1.0))


def stamps(n: int = 8000) -> Floats:
    return PERIOD * np.arange(float(n))


def measured(time_s: Floats) -> Floats:
    return np.asarray(RESOLUTION * (np.floor(motion(time_s) / RESOLUTION) + 0.5))


@pytest.mark.parametrize("ratio", [0.61, 0.79, 0.944, 1.0588, 1.19])
def test_the_clock_is_found(ratio: float) -> None:
    time_s, period_s, first_s = stamps(), ratio * PERIOD, 3.7e-4
    age = np.mod(time_s - first_s, period_s)
    found = own_clock(time_s, measured(time_s - age), RESOLUTION)
    assert found is not None
    assert found.period_s == pytest.approx(period_s, rel=1e-5)
    late = np.mod(found.age_s(time_s) - age + 0.5 * period_s, period_s) - 0.5 * period_s
    assert np.abs(late).max() < 0.1 * PERIOD


def test_it_is_found_from_the_part_with_motion_in_a_long_record() -> None:
    time_s = stamps(40_000)
    age = np.mod(time_s, 0.83 * PERIOD)
    moves = np.clip((time_s - 25.0) / 5.0, 0.0, 1.0)
    found = own_clock(time_s, np.asarray(RESOLUTION * np.floor(moves * motion(time_s - age) / RESOLUTION)), RESOLUTION)
    assert found is not None
    assert found.period_s == pytest.approx(0.83 * PERIOD, rel=1e-5)


@pytest.mark.parametrize("cells", [0.7, 1.13, 1.6])
def test_an_encoder_at_a_constant_speed_is_no_clock(cells: float) -> None:
    time_s = stamps()
    position = np.asarray(RESOLUTION * np.floor(cells * time_s / PERIOD))
    assert own_clock(time_s, position, RESOLUTION) is None
    assert own_clock(time_s, position, 0.0) is not None  # but for the size of its steps it looks like one


def test_what_has_no_clock_of_its_own_has_none() -> None:
    time_s, rng = stamps(), np.random.default_rng(1)
    for late in (0.0, 0.3 * PERIOD, 2.0 * PERIOD):
        assert own_clock(time_s, measured(time_s - late), RESOLUTION) is None
    assert own_clock(time_s, measured(time_s - PERIOD * rng.uniform(0.0, 1.0, time_s.size)), RESOLUTION) is None
    assert own_clock(time_s, np.zeros(time_s.size), RESOLUTION) is None
    assert own_clock(time_s, measured(time_s) + 2e-3 * np.sin(2.0 * np.pi * 81.0 * time_s), RESOLUTION) is None
    held = time_s - np.mod(time_s, 0.83 * PERIOD)
    assert own_clock(time_s[:150], measured(held)[:150], RESOLUTION) is None
    assert own_clock(time_s + 0.1 * PERIOD * rng.uniform(0.0, 1.0, time_s.size), measured(held), RESOLUTION) is None


@pytest.mark.parametrize("ratio", [0.79, 1.19])
def test_the_record_at_the_device_s_samples_has_its_positions_and_the_same_charge(ratio: float) -> None:
    time_s = stamps()
    age = np.mod(time_s - 3.7e-4, ratio * PERIOD)
    clock = own_clock(time_s, measured(time_s - age), RESOLUTION)
    assert clock is not None
    current = np.sin(2.0 * np.pi * 7.0 * time_s)
    found = at_the_samples(time_s, current, clock)
    assert (np.diff(found.time_s) > 0.9 * clock.period_s).all()
    assert found.rows.size == pytest.approx(time_s.size / max(ratio, 1.0), rel=0.03)
    assert np.abs(measured(time_s - age)[found.rows] - motion(found.time_s)).max() < 6.0 * RESOLUTION
    waits = np.append(np.diff(found.time_s), clock.period_s)
    part = slice(100, 200)
    held = np.append(0.0, np.cumsum(current) * PERIOD)
    charge = np.interp(found.time_s[[100, 200]], np.append(time_s, time_s[-1] + PERIOD), held)
    assert float(np.sum((found.current * waits)[part])) == pytest.approx(float(np.diff(charge)[0]), abs=1e-12)
