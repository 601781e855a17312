"""The evidence: calibrated when nothing is there, sure when something is, not bought by a few windows."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.gap.evidence import (
    MINIMUM_GAIN,
    MINIMUM_SHARE,
    Scored,
    compare,
    minimum_gain,
    threshold,
    window_loss,
    window_weight,
)

WINDOWS, LENGTH = 400, 32
BLOCK = np.arange(WINDOWS) // 20


def scored(residuals: np.ndarray) -> Scored:
    square = np.mean(residuals**2, axis=1)
    return Scored(window_loss(square, float(LENGTH)), square, (residuals,))


def fitted_line(noise: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Residuals after fitting the amplitude of a shape, held out fold by fold."""
    left = noise.copy()
    fold = BLOCK % 5
    for k in range(5):
        train, test = fold != k, fold == k
        amplitude = np.sum(noise[train] * shape[train]) / np.sum(shape[train] ** 2)
        left[test] = noise[test] - amplitude * shape[test]
    return left


def test_threshold_is_bonferroni() -> None:
    assert threshold(1.0) == pytest.approx(2.5758, abs=1e-3)
    assert threshold(24.0) > threshold(1.0)


def test_weight_is_the_slope_of_the_loss() -> None:
    square = np.array([0.3, 1.0, 20.0])
    step = 1e-6
    slope = (window_loss(square + step, 1.0) - window_loss(square, 1.0)) / step
    np.testing.assert_allclose(window_weight(square), slope, rtol=1e-4)


@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_false_alarms_on_noise(correlation: float) -> None:
    """White or strongly autocorrelated residuals: an irrelevant regressor exceeds 2.58 in at most 1.5 % of the trials."""
    rng = np.random.default_rng(7)
    alarms, trials = 0, 300
    for _ in range(trials):
        noise = rng.standard_normal((WINDOWS, LENGTH))
        # A force error that drifts from window to window, as an incomplete model leaves it.
        drift = np.zeros(WINDOWS)
        for w in range(1, WINDOWS):
            drift[w] = correlation * drift[w - 1] + correlation * rng.standard_normal()
        bend = np.linspace(-1.0, 1.0, LENGTH) ** 2 - 1.0 / 3.0
        noise = noise + drift[:, None] * bend
        slow = np.repeat(rng.standard_normal(WINDOWS // 8), 8)
        shape = slow[:, None] * bend
        alarms += compare(scored(fitted_line(noise, shape)), scored(noise), BLOCK, noise.size).z > threshold(1.0)
    assert alarms <= 0.015 * trials


def test_a_real_effect_is_sure_though_most_windows_do_not_show_it() -> None:
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((WINDOWS, LENGTH))
    shape = np.zeros((WINDOWS, LENGTH))
    shape[140:180] = np.linspace(-2.0, 2.0, LENGTH)
    result = compare(scored(noise), scored(noise + shape), BLOCK, noise.size)
    assert result.z > threshold(24.0) + 1.0
    assert result.gain_per_sample > MINIMUM_GAIN


def test_two_windows_buy_nothing() -> None:
    rng = np.random.default_rng(2)
    noise = rng.standard_normal((WINDOWS, LENGTH))
    worse = noise.copy()
    worse[[33, 250]] += 40.0 * np.linspace(-1.0, 1.0, LENGTH)
    assert compare(scored(noise), scored(worse), BLOCK, noise.size).z < threshold(24.0)


def test_of_a_model_far_off_a_twentieth_of_what_is_missing_counts() -> None:
    assert minimum_gain(np.ones(WINDOWS)) == pytest.approx(MINIMUM_GAIN)
    barely = np.full(WINDOWS, 1.08)
    assert minimum_gain(barely) == pytest.approx(MINIMUM_GAIN * 1.08 * float(window_weight(barely)[0]))
    far = np.full(WINDOWS, 30.0)
    assert minimum_gain(far) == pytest.approx(MINIMUM_SHARE * 29.0 * float(window_weight(far)[0]))


def test_a_small_part_of_a_large_gap_is_sure_but_does_not_count() -> None:
    rng = np.random.default_rng(3)
    missing = 8.0 * np.outer(rng.standard_normal(WINDOWS), np.linspace(-1.0, 1.0, LENGTH) ** 2)
    noise = rng.standard_normal((WINDOWS, LENGTH)) + missing
    small = 0.6 * np.outer(rng.standard_normal(WINDOWS), np.linspace(-1.0, 1.0, LENGTH))
    result = compare(scored(noise), scored(noise + small), BLOCK, noise.size)
    assert result.z > threshold(24.0)
    assert not result.significant(24.0)
