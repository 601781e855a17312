"""Stamps that lie on a grid: what they say of when samples were taken, and what they must not change."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hapticd.config import Config
from hapticd.gap.data import load_recording
from hapticd.gap.recording import Recording
from hapticd.record.stamp_grid import spread, step_of_stamps

RATE_HZ = 997.0


def rows(missing: int = 0, count: int = 8000) -> np.ndarray:
    """Numbers of the samples of a record, one in `missing` not there."""
    number = np.arange(count)
    return number if not missing else number[number % missing != missing // 2]


def floored(time_s: np.ndarray, step: float) -> np.ndarray:
    return np.floor(time_s / step) * step


@pytest.mark.parametrize("missing", [0, 777])
@pytest.mark.parametrize(("rate_hz", "step"), [(RATE_HZ, 1e-3), (2003.0, 1e-3), (40.3, 1e-3), (990.0, 1e-4)])
def test_samples_of_an_even_clock_are_spread_evenly(rate_hz: float, step: float, missing: int) -> None:
    taken = rows(missing) / rate_hz
    stamps = floored(taken, step)
    found, of_grid = spread(stamps)
    assert of_grid == pytest.approx(step)
    error = np.diff(found) - np.diff(taken)
    odd = np.abs(error) > 0.02 * step
    assert np.mean(odd) <= (2.0 / missing if missing else 0.0)  # a missing sample may be seen some rows late
    assert np.all(np.abs(found - stamps - 0.5 * step) < 1.5 * step)


def test_seconds_in_single_precision_after_hours_are_on_a_grid() -> None:
    taken = 9000.0 + rows() / RATE_HZ
    stamps = taken.astype(np.float32).astype(np.float64)
    found, step = spread(stamps)
    assert step == pytest.approx(2.0**-10)
    assert np.std(np.diff(found) - 1.0 / RATE_HZ) < 1e-8


@pytest.mark.parametrize("lateness", [0.0, 3e-5])
def test_exact_stamps_stay_as_they_are(lateness: float) -> None:
    late = np.random.default_rng(1).exponential(lateness, 8000) if lateness else 0.0
    stamps = np.round(rows() / RATE_HZ + late, 6)
    found, step = spread(stamps)
    assert step == 0.0
    assert np.array_equal(found, stamps)


def test_a_clock_less_even_than_its_grid_stays_as_it_is() -> None:
    waits = np.random.default_rng(2).uniform(0.2e-3, 5e-3, 8000)
    stamps = floored(np.cumsum(waits), 1e-4)
    found, step = spread(stamps)
    assert step == 0.0
    assert np.array_equal(found, stamps)


def test_stamps_a_period_apart_say_nothing_more() -> None:
    stamps = rows() * 1e-3
    assert np.array_equal(spread(stamps)[0], stamps)
    assert step_of_stamps(np.full(10, 2.0)) == 0.0


def test_a_clock_that_was_set_goes_on_from_there() -> None:
    taken = rows() / RATE_HZ + np.where(rows() < 4000, 0.0, 5.25e-3)
    found, _ = spread(floored(taken, 1e-3))
    error = np.diff(found) - np.diff(taken)
    assert np.sum(np.abs(error) > 1e-4) <= 1
    assert np.all(np.abs(found - taken) < 1.5e-3)


def test_a_record_with_whole_milliseconds_says_so_and_is_read_as_if_they_were_exact(tmp_path: Path) -> None:
    taken = rows() / RATE_HZ
    counts = np.round(2000.0 * np.sin(6.0 * taken)).astype(int)
    current = 0.5 * np.cos(6.0 * taken)

    def read(name: str, stamps: np.ndarray) -> Recording:
        lines = [f"{t:.6f},{c},{i:.6f}" for t, c, i in zip(stamps, counts, current, strict=True)]
        path = tmp_path / name
        path.write_text("\n".join(["time_s,encoder_counts,current_command_A", *lines]))
        return load_recording(path, Config())

    rounded, exact = read("ms.csv", floored(taken, 1e-3)), read("exact.csv", taken)
    assert np.std(np.diff(rounded.time_s - exact.time_s)) < 1e-6
    assert any("the stamps lie on a grid of 1 ms, 1 of a period" in warning for warning in rounded.warnings)
    assert not any("grid" in warning for warning in exact.warnings)
