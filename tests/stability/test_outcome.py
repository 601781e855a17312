from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.stability.numbers import Dimensionless, Loop
from hapticd.stability.outcome import STRETCHES, Outcome, OutcomeTracker, energy_rises

from .motion import simulate

time = np.arange(20_000.0)
ripple = 0.01 * np.sin(0.37 * time)


def classify(energy: np.ndarray, at_rest: bool, grew_past_limit: bool) -> Outcome:
    """What a run with these energies at its samples is called, all taken in at once."""
    tracker = OutcomeTracker()
    tracker.update(energy)
    return tracker.outcome(at_rest, grew_past_limit)


@pytest.mark.parametrize(
    ("energy", "expected"),
    [
        (np.exp(-time * 1e-3), "monotone"),
        (np.exp(-time * 1e-3) * (1 + ripple), "decaying"),
        (np.exp(time * 1e-4) * (1 + ripple), "growing"),
        (np.exp(time * 1e-3), "growing"),
        (1.0 + ripple, "persistent"),
        (np.exp(-time * 1e-3) + 0.1 * (1 + ripple), "persistent"),  # settled into a cycle
        (np.exp(-time * 2e-4) + 0.5 * (1 + 1e-3 * ripple), "persistent"),  # still settling, seen to end above zero
        (1.0 - 0.9 * np.exp(-time * 2e-4), "persistent"),  # growing into a cycle
        ((1.0 - time / 30_000.0) ** 2 * (1 + ripple), "decaying"),  # linear decay of the amplitude, Coulomb friction
        (1.0 + 0.2 * np.random.default_rng(3).random(20_000), "persistent"),  # an irregular cycle
        (np.r_[time[:10], np.inf], "growing"),
        (np.r_[time[:10], np.nan], "growing"),
    ],
)
def test_shapes_of_energy(energy: np.ndarray, expected: str) -> None:
    assert classify(energy, at_rest=False, grew_past_limit=False) == expected
    assert classify(1e-9 * energy, at_rest=False, grew_past_limit=False) == expected


def test_rest_is_never_persistent() -> None:
    assert classify(np.full(1000, 0.36), at_rest=True, grew_past_limit=False) == "monotone"
    assert classify(np.array([1.0, 1.2, 0.3, 0.3]), at_rest=True, grew_past_limit=False) == "decaying"
    assert classify(np.array([0.0]), at_rest=True, grew_past_limit=False) == "monotone"
    assert classify(np.array([]), at_rest=True, grew_past_limit=False) == "monotone"


def test_past_the_limit_is_growing_whatever_the_energy() -> None:
    assert classify(np.array([1.0, 0.5]), at_rest=False, grew_past_limit=True) == "growing"


def test_rounding_is_not_a_rise() -> None:
    energy = np.array([5.0, 5.0 * (1 + 1e-12), 4.0, 4.0])
    assert not energy_rises(energy).any()
    assert energy_rises(np.array([1.0, 1.0 + 1e-6])).all()
    assert not energy_rises(np.zeros(5)).any()


def test_a_short_falling_run_is_monotone() -> None:
    assert classify(np.array([3.0, 2.0, 1.0]), at_rest=False, grew_past_limit=False) == "monotone"


@given(st.lists(st.integers(0, 700), min_size=1, max_size=30), st.integers(0, 2**32 - 1))
def test_chunks_do_not_matter(sizes: list[int], seed: int) -> None:
    energy = np.random.default_rng(seed).random(sum(sizes)) * np.exp(-np.arange(sum(sizes)) * 1e-3)
    tracker = OutcomeTracker()
    for chunk in np.split(energy, np.cumsum(sizes)[:-1]):
        tracker.update(chunk)
    whole = OutcomeTracker()
    whole.update(energy)
    assert (tracker.samples, tracker.rises) == (energy.size, int(energy_rises(energy).sum()))
    np.testing.assert_array_equal(tracker.tail_peaks(), whole.tail_peaks())
    assert tracker.outcome(False) == classify(energy, False, False)


def test_peaks_are_those_of_six_stretches_of_the_second_half() -> None:
    energy = np.random.default_rng(1).random(1 << 16)
    tracker = OutcomeTracker()
    tracker.update(energy)
    tail = energy[1 << 15 :]
    peaks = tracker.tail_peaks()
    assert peaks.shape == (STRETCHES,)
    assert peaks.max() == tail.max()
    block = (1 << 16) // 512
    for k, peak in enumerate(peaks):
        near = tail[max(0, k * tail.size // 6 - block) : (k + 1) * tail.size // 6 + block]
        assert peak in near


def test_memory_is_bounded() -> None:
    tracker = OutcomeTracker()
    for _ in range(200):
        tracker.update(np.ones(10_007))
    assert tracker.samples == 200 * 10_007
    assert sum(np.asarray(v).nbytes for v in vars(tracker).values() if v is not None) < 8192


@pytest.mark.parametrize(
    ("rate", "decimation", "deflection", "expected", "final"),
    [
        (1000, 217, 20.3, {"monotone", "decaying"}, -0.7251),
        (1000, 2172, 3.3, {"persistent"}, None),
        (100, 217, 2.3, {"monotone", "decaying"}, -0.9322),
        (100, 217, 10.3, {"growing"}, None),
    ],
)
def test_the_four_cases_of_fig_8(
    rate: float, decimation: int, deflection: float, expected: set[str], final: float | None
) -> None:
    n = Loop(6.28e-6, 9e-6, 2e-3, 0.012, 2.0 * math.pi / 8192 * decimation, 1.0 / rate).numbers
    run = simulate(n, deflection, 0.0, 20_000)
    assert classify(run.energy(), run.at_rest, run.grew) in expected
    if final is not None:
        assert run.samples[-1][0] == pytest.approx(final, abs=5e-5)


@pytest.mark.parametrize("velocity", [1.0, 10.0])
def test_twice_the_horizon_changes_nothing(velocity: float) -> None:
    changed = []
    for beta in (0.1, 0.3, 0.6, 0.9, 1.4):
        for sigma in (0.0, 0.3, 0.45, 0.7, 1.5, 2.5):
            run = simulate(Dimensionless(100.0, beta, sigma), 0.0, velocity, 8_000)
            energy = run.energy()
            ended = energy.size < 4_000
            short = classify(energy[:4_000], run.at_rest and ended, run.grew and ended)
            if short != classify(energy, run.at_rest, run.grew):
                changed.append((beta, sigma, short))
    assert not changed
