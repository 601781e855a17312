"""The block jackknife: right for independent samples, wider where a disturbance hangs together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from hapticd.identify.intervals import BLOCKS, blocks_of, jackknife, student_reach


def scores_of_a_mean(noise: np.ndarray, s: float) -> tuple[float, np.ndarray]:
    """Estimate of a mean by normal samples of deviation s, and the scores there."""
    mean = float(noise.mean())
    return mean, ((noise - mean) / s**2)[:, None]


def test_independent_samples_give_the_textbook_error() -> None:
    rng = np.random.default_rng(1)
    found = [
        float(np.sqrt(jackknife(scores_of_a_mean(rng.normal(size=2000), 1.0)[1], np.arange(2000) // 200)[0, 0]))
        for _ in range(100)
    ]
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(1.0 / np.sqrt(2000), rel=0.3)
    assert min(found) >= 0.95 / np.sqrt(2000)


def test_intervals_cover_where_samples_hang_together() -> None:
    rng = np.random.default_rng(2)
    covered, naive = 0, 0
    for _ in range(200):
        noise = lfilter([1.0], [1.0, -0.98], rng.normal(size=4000))
        mean, scores = scores_of_a_mean(noise, float(noise.std()))
        spread = float(np.sqrt(jackknife(scores, np.arange(4000) // 400)[0, 0]))
        covered += abs(mean) < student_reach() * spread
        naive += abs(mean) < 1.96 * float(noise.std()) / np.sqrt(4000)
    assert covered >= 180
    assert naive < 80


def test_blocks_are_of_equal_time_over_all_recordings() -> None:
    time_s = np.concatenate([np.arange(1000), np.arange(3000)]) * 1e-3
    block = blocks_of(time_s, np.repeat([0, 1], [1000, 3000]))
    assert block[0] == 0
    assert block[-1] == BLOCKS - 1
    assert np.all(np.abs(np.bincount(block) - 400) <= 2)
