"""The smoother against low-passes of every bandwidth, and the filter's consistency with forces."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from hapticd.gap.data import Recording
from hapticd.gap.smooth import (
    LowPass,
    acceleration_of,
    default_bandwidth,
    held_mean,
    motion_of,
    position_noise,
    uniform,
)

PERIOD = 1e-3
CELL = 2 * np.pi / 8192
TIME = np.arange(10_000) * PERIOD


def recorded(position: NDArray[np.float64], time: NDArray[np.float64] = TIME) -> Recording:
    cells = (np.floor(position / CELL) + 0.5) * CELL
    return Recording("t", time, cells, CELL, np.zeros(time.size), None, PERIOD, None, False, None)


MOTIONS = {
    "slow": (0.3 * np.cos(2 * np.pi * 0.3 * TIME), 0.3 / (2 * np.pi * 0.3) * np.sin(2 * np.pi * 0.3 * TIME)),
    "fast": (30 * np.cos(2 * np.pi * 2 * TIME), 30 / (4 * np.pi) * np.sin(2 * np.pi * 2 * TIME)),
    "with a buzz": (
        6 * np.cos(4.4 * TIME) + 10 * np.cos(56.5 * TIME),
        6 / 4.4 * np.sin(4.4 * TIME) + 10 / 56.5 * np.sin(56.5 * TIME),
    ),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_velocity_is_as_good_as_the_best_low_pass(name: str) -> None:
    velocity, position = MOTIONS[name]
    recording = recorded(position)
    inner = slice(300, -300)
    found = np.std((motion_of(recording).velocity - velocity)[inner])
    low_passed = [
        np.std(
            (np.gradient(sosfiltfilt(butter(4, hz, fs=1e3, output="sos"), recording.position), PERIOD) - velocity)[
                inner
            ]
        )
        for hz in (5.0, 10.0, 20.0, 40.0, 80.0)
    ]
    assert found < 1.15 * min(low_passed)


def test_noise_is_the_cell_or_what_differences_show() -> None:
    recording = recorded(MOTIONS["fast"][1])
    assert position_noise(recording) == pytest.approx(CELL / np.sqrt(12), rel=0.15)
    noisy = recorded(MOTIONS["fast"][1] + np.random.default_rng(1).normal(0.0, 3 * CELL, TIME.size))
    assert position_noise(noisy) == pytest.approx(3 * CELL, rel=0.05)


def test_bandwidth_falls_with_noise_and_stays_within_limits() -> None:
    recording = recorded(MOTIONS["fast"][1])
    assert default_bandwidth(recording, 1e-12, 1.0) == pytest.approx(100.0)
    assert default_bandwidth(recording, 1e3, 1.0) == pytest.approx(10.0)
    assert 10.0 < default_bandwidth(recording, 2e-4, 0.01) < default_bandwidth(recording, 2e-5, 0.01) < 100.0


def test_jittered_stamps_are_put_on_a_uniform_grid() -> None:
    time = TIME + np.random.default_rng(2).uniform(-3e-4, 3e-4, TIME.size)
    time -= time[0]
    recording = Recording("t", time, np.sin(3.0 * time), 0.0, 0 * time, None, PERIOD, None, False, None)
    grid, position = uniform(recording)
    assert np.allclose(np.diff(grid), PERIOD, rtol=0, atol=1e-12)
    assert np.abs(position - np.sin(3.0 * grid)).max() < 1e-9


def test_held_force_balances_the_second_difference_exactly() -> None:
    current = np.random.default_rng(3).normal(size=500)
    time = np.arange(500) * PERIOD
    velocity = np.concatenate([[0.0], np.cumsum(current[:-1]) * PERIOD])
    position = np.concatenate([[0.0], np.cumsum(velocity[:-1] * PERIOD + 0.5 * current[:-1] * PERIOD**2)])
    recording = Recording("t", time, position, 0.0, current, None, PERIOD, None, False, None)
    held = held_mean(recording, current, time, 0.0)
    assert np.allclose(held[1:-1], acceleration_of(position, PERIOD)[1:-1], rtol=0, atol=1e-6)


def test_held_mean_is_later_by_the_delay() -> None:
    current = np.where(TIME >= 5.0, 1.0, 0.0)
    recording = Recording("t", TIME, 0 * TIME, 0.0, current, None, PERIOD, None, False, None)
    late = held_mean(recording, current, TIME, 0.0025)
    assert (held_mean(recording, current, TIME, 0.0) - late).sum() * PERIOD == pytest.approx(0.0025, abs=1e-9)


def test_low_pass_keeps_slow_signals_and_drops_fast_ones() -> None:
    low_pass = LowPass(40.0, PERIOD)
    slow, fast = np.sin(2 * np.pi * 3 * TIME), np.sin(2 * np.pi * 200 * TIME)
    assert np.allclose(low_pass(slow), slow[low_pass.rows(TIME.size)], atol=1e-3)
    assert np.abs(low_pass(fast)).max() < 1e-4
    assert low_pass.every == 10


def test_too_few_samples_are_refused() -> None:
    short = recorded(np.zeros(5), TIME[:5])
    with pytest.raises(ValueError, match="5 samples are too few"):
        motion_of(short)
