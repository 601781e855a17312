"""Commands in force: cut at the instants at which they change, no charge lost, and what lost commands leave to chance."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hapticd.gap.kernel.commands import in_force, lagging, segments
from hapticd.plant.electrical import electrical
from hapticd.plant.layout import index_of, neutral_vector

T = 1e-3


def cut(
    time_s: NDArray[np.float64], command: NDArray[np.float64], delay: float, parts: int = 2, **words: float
) -> tuple[NDArray[np.float64], ...]:
    p = neutral_vector()
    for name, value in words.items():
        p[index_of(name.replace("__", "."))] = value
    found = tuple(np.full((time_s.size, parts), np.nan) for _ in range(3))
    segments(p, time_s, command, np.arange(time_s.size) * 0.1, delay, *found)
    return found


def in_force_at(time_s: Any, command: Any, delay: float, at: float) -> float:
    """The command in force at an instant: the last one that is due, the first before any is."""
    sent = np.flatnonzero(np.asarray(time_s) + delay <= at)
    return float(command[sent[-1]] if sent.size else command[0])


def charge_by_sums(time_s: Any, command: Any, delay: float, begin: float, end: float) -> float:
    changes = np.asarray(time_s) + delay
    edges = np.concatenate([[begin], changes[(changes > begin) & (changes < end)], [end]])
    values = [in_force_at(time_s, command, delay, 0.5 * (a + b)) for a, b in itertools.pairwise(edges)]
    return float(np.sum(np.diff(edges) * values))


TIME = T * np.arange(40)
COMMAND = np.random.default_rng(3).normal(size=40)


def test_a_period_is_split_at_the_delay() -> None:
    duration, current, spread = cut(TIME, COMMAND, 0.3e-3)
    assert duration[5:-1] == pytest.approx(np.tile([0.3e-3, 0.7e-3], (34, 1)))
    assert np.array_equal(current[5, :], [COMMAND[4], COMMAND[5]])
    assert np.array_equal(spread[5, :], [0.4, 0.5])
    assert np.array_equal(current[0, :], [COMMAND[0], COMMAND[0]])


def test_without_a_delay_one_part_does() -> None:
    duration, current, _ = cut(TIME, COMMAND, 0.0, parts=1)
    assert duration[:, 0] == pytest.approx(np.full(40, T))
    assert np.array_equal(current[:, 0], COMMAND)


@pytest.mark.parametrize("delay", [0.0, 0.2e-3, 0.999e-3, 1e-3, 1.7e-3, 3.25e-3])
@pytest.mark.parametrize("parts", [1, 2, 3, 5])
@pytest.mark.parametrize("jitter", [0.0, 4e-4])
def test_no_charge_is_lost(delay: float, parts: int, jitter: float) -> None:
    time_s = TIME + jitter * np.random.default_rng(1).random(40)
    duration, current, _ = cut(time_s, COMMAND, delay, parts)
    ends = np.append(time_s[1:], 2.0 * time_s[-1] - time_s[-2])
    assert duration.sum(axis=1) == pytest.approx(ends - time_s)
    for k in range(40):
        expected = charge_by_sums(time_s, COMMAND, delay, time_s[k], ends[k])
        assert float(duration[k] @ current[k]) == pytest.approx(expected, abs=1e-12)


def test_parts_are_in_the_order_of_time() -> None:
    """With jitter two commands may fall due within one period."""
    time_s = np.array([0.0, 1.0, 2.0, 3.9, 4.1, 5.0, 6.0]) * T
    command = np.arange(7.0)
    duration, current, _ = cut(time_s, command, 0.5e-3, parts=3)
    at = np.cumsum(duration[4]) - 0.5 * duration[4] + time_s[4]
    for k in range(3):
        if duration[4, k] > 0.0:
            assert current[4, k] == in_force_at(time_s, command, 0.5e-3, at[k])
    assert duration[4] == pytest.approx([0.3e-3, 0.2e-3, 0.4e-3])


def test_current_is_what_the_converter_delivers() -> None:
    _, current, _ = cut(TIME, COMMAND, 0.3e-3, current_saturation__i_max=0.5, dac_quantization__q=0.2)
    assert np.abs(current).max() <= 0.5
    inner = current[np.abs(current) < 0.45]
    assert inner / 0.2 == pytest.approx(np.rint(inner / 0.2), abs=1e-9)
    assert np.unique(np.round(inner, 6)).size >= 3


@pytest.mark.parametrize(("f_a", "delta"), [(0.3, 2.0), (20.0, 1.0), (80.0, 0.7), (3000.0, 0.5)])
@pytest.mark.parametrize("delay", [-0.4e-3, 0.0, 0.3e-3, 2.2e-3])
def test_two_halves_move_a_mass_as_the_lagging_current_does(f_a: float, delta: float, delay: float) -> None:
    """Velocity and way at the end of each period, stamps that jitter, against many short parts of the plant's current."""
    p = neutral_vector()
    for name, value in (("amplifier_lag.f_a", f_a), ("amplifier_lag.delta", delta), ("delay_s", delay)):
        p[index_of(name)] = value
    time_s = TIME + 4e-4 * np.random.default_rng(1).random(40)
    duration, aim, _ = cut(time_s, COMMAND, delay, parts=5)
    halves, fine = np.empty((40, 2)), np.empty((40, 2048))
    lagging(p, duration, aim, halves)
    electrical(p, time_s, COMMAND, np.zeros(40, dtype=np.uint8), 2048, fine)
    left = 1.0 - (np.arange(2048) + 0.5) / 2048.0
    assert halves.mean(axis=1) == pytest.approx(fine.mean(axis=1), abs=1e-9)
    assert halves @ [0.75, 0.25] / 2.0 == pytest.approx(fine @ left / 2048.0, abs=1e-6)


@pytest.mark.parametrize("loss", [0.0, 0.1, 0.5, 0.9])
def test_lost_commands_have_the_moments_of_chance(loss: float) -> None:
    command = COMMAND[:12]
    mean, deviation = np.empty(12), np.empty(12)
    in_force(command, loss, mean, deviation)
    rng = np.random.default_rng(2)
    draws = 40_000
    held = np.full(draws, command[0])
    for k in range(12):
        held = np.where(rng.random(draws) < loss, held, command[k])
        assert mean[k] == pytest.approx(held.mean(), abs=5.0 * held.std() / np.sqrt(draws) + 1e-12)
        assert deviation[k] == pytest.approx(held.std(), rel=0.03, abs=1e-9)
