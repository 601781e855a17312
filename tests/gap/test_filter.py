"""The filter: cells of a normal density, a textbook's Kalman filter where there is one, and what it does with bad data."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm, truncnorm

from hapticd.gap.kernel.cell import truncated
from hapticd.gap.kernel.modes import OUTLIER
from hapticd.gap.kernel.samples import Samples
from hapticd.plant.layout import index_of

from . import linear_case
from .linear_case import case, filtered, textbook

NOISES = {
    "white": np.array([0.02, 1e-4, 1e-9, 0.05, 0.0]),
    "coloured": np.array([0.002, 1e-4, 0.5, 0.05, 0.0]),
    "as fast as the samples": np.array([0.002, 1e-4, 0.5, 2.5e-3, 0.0]),
    "fine sensor": np.array([0.01, 1e-6, 0.1, 0.02, 0.0]),
}


@pytest.mark.parametrize("width", [2e-3, 0.02, 0.3, 1.0, 4.0, 30.0])
@pytest.mark.parametrize("low", [-30.0, -9.0, -5.5, -4.0, -1.0, -0.2, 0.0, 0.5, 3.0, 4.9, 5.1, 8.0, 25.0])
def test_a_cell_of_the_normal_density(low: float, width: float) -> None:
    high = low + width
    mass, exponent, mean, variance = truncated(low, high)
    log_mass = math.log(mass) + exponent
    # By symmetry on the side where the survival function keeps its digits.
    a, b = (low, high) if low + high > 0.0 else (-high, -low)
    exact = math.log(norm.sf(a) - norm.sf(b)) if a > -5.0 else math.log(norm.cdf(b) - norm.cdf(a))
    near = a > 5.0  # the tail's expansion, far below the probability of an outlier
    assert log_mass == pytest.approx(exact, abs=1.5 / a**2 if near else 1e-6)
    expected = math.copysign(float(truncnorm.mean(a, b)), low + high) if a != -b else 0.0
    assert mean == pytest.approx(expected, abs=0.02 if near else 1e-4)
    assert low - 1e-9 <= mean <= high + 1e-9
    if not near:
        assert variance == pytest.approx(float(truncnorm.var(a, b)), rel=1e-3, abs=2e-9)
    assert 0.0 < variance <= 1.0


@pytest.mark.parametrize("low", [-3.0, 0.0, 0.7, 4.0])
def test_a_cell_that_is_nearly_a_point(low: float) -> None:
    width = 1e-5
    mass, exponent, mean, variance = truncated(low, low + width)
    assert math.log(mass) + exponent == pytest.approx(norm.logpdf(low) + math.log(width), abs=1e-4)
    assert mean == pytest.approx(low, abs=width)
    assert variance == pytest.approx(width**2 / 12.0)


def test_both_tails_are_alike() -> None:
    for low, high in [(0.3, 0.9), (2.0, 2.01), (5.2, 6.0), (12.0, 12.5)]:
        right, left = truncated(low, high), truncated(-high, -low)
        assert right[:2] == left[:2]
        assert right[2] == -left[2]
        assert right[3] == left[3]


@pytest.mark.parametrize("periods", [(1e-3,), (1e-3, 1.7e-3, 1.7e-3, 0.4e-3)])
@pytest.mark.parametrize("kind", NOISES)
def test_without_dry_friction_it_is_a_kalman_filter(kind: str, periods: tuple[float, ...]) -> None:
    one = case(NOISES[kind], periods=periods)
    total, out = filtered(one)
    exact = textbook(one)
    deviation = np.sqrt(exact.variance)
    assert np.abs((out["mean"] - exact.mean) / deviation).max() < 0.01
    assert out["variance"] == pytest.approx(exact.variance, rel=0.01)
    density = norm.pdf(one.measured + 0.5 * one.resolution, exact.mean, deviation)
    expected = np.log(density * one.resolution + OUTLIER * one.resolution / one.noise[1])
    assert total == pytest.approx(expected.sum(), abs=0.5)
    assert total == pytest.approx(out["log_p"].sum(), abs=1e-6)
    innovation = (one.measured + 0.5 * one.resolution - out["mean"]) / np.sqrt(out["variance"])
    assert np.std(innovation[50:]) == pytest.approx(1.0, abs=0.12)
    assert out["moved"] == pytest.approx(innovation * np.sqrt(out["variance"]), rel=1e-2, abs=2.0 * one.resolution)


def test_cells_far_below_the_noise_are_as_good_as_a_density() -> None:
    """A record of positions in SI units shows no cells: how wide they are taken decides nothing, outliers included."""
    wide = case(NOISES["white"], cell_share=1e-2)
    wide.measured[300] += 5.0 * wide.noise[1]
    narrow = wide._replace(resolution=0.1 * wide.resolution, measured=wide.measured + 0.45 * wide.resolution)
    difference = filtered(narrow)[1]["log_p"] - filtered(wide)[1]["log_p"]
    assert difference == pytest.approx(np.full(difference.size, -math.log(10.0)), abs=1e-3)


def test_wide_cells_are_probabilities() -> None:
    """Over all cells of the next count the probabilities add up to one, up to what outliers have."""
    one = case(NOISES["coloured"], n=60, cell_share=8.0)
    total = 0.0
    for cell in range(-6, 7):
        moved = one.measured.copy()
        moved[-1] = moved[-2] + cell * one.resolution
        total += math.exp(filtered(one._replace(measured=moved))[1]["log_p"][-1])
    assert total == pytest.approx(1.0 + 13 * OUTLIER, abs=1e-3)


def test_score_and_information_are_slopes_of_the_log_probability() -> None:
    """The cell shifted is the mean shifted the other way."""
    one = case(NOISES["coloured"], n=200, cell_share=3.0)
    _, out = filtered(one)
    h = 1e-3 * one.resolution
    for k in range(20, 200, 20):
        ends = []
        for sign in (1.0, -1.0):
            moved = one.measured.copy()
            moved[k] -= sign * h
            ends.append(filtered(one._replace(measured=moved))[1]["log_p"][k])
        assert out["score"][k] == pytest.approx((ends[0] - ends[1]) / (2.0 * h), rel=1e-3)
        assert 0.0 < out["information"][k] <= 1.0 / out["variance"][k]


def test_a_restart_forgets_the_state() -> None:
    one = case(NOISES["coloured"], n=300)
    begins = np.zeros(300, dtype=bool)
    begins[[0, 150]] = True
    _, out = filtered(one, begins)
    second = one._replace(
        time_s=one.time_s[150:], current=one.current[150:], measured=one.measured[150:], states=one.states[150:]
    )
    _, alone = filtered(second)
    for name in ("log_p", "mean", "x", "v", "d"):
        assert out[name][150:] == pytest.approx(alone[name], rel=1e-9, abs=1e-12), name
    assert out["d_d"][149] == 0.0
    assert out["x_v"][149] == 0.0
    assert out["d_d"][148] > 0.0


def test_an_outlier_costs_no_more_than_its_probability() -> None:
    one = case(NOISES["coloured"], cell_share=1.0)
    clean, _ = filtered(one)
    moved = one.measured.copy()
    moved[300] += 1e4 * one.resolution
    _, out = filtered(one._replace(measured=moved))
    assert out["log_p"][300] == pytest.approx(math.log(OUTLIER), abs=1e-6)
    assert out["score"][300] == pytest.approx(0.0, abs=1e-6)
    assert out["log_p"].min() >= math.log(OUTLIER) - 1e-9
    assert math.isfinite(clean)


def test_no_count_strains_a_bristle_beyond_sliding() -> None:
    """A bristle of thousands of breakaways would let go in as many turns, each a phase of the plant's."""
    one = case(NOISES["coloured"], n=200, cell_share=1.0)
    moved = one.measured.copy()
    moved[100] += 1e4 * one.resolution
    p = linear_case.device()
    breakaway = p[index_of("presliding.breakaway")] = 1e-3
    p[index_of("coulomb")] = 50.0
    _, out = filtered(one._replace(measured=moved), p=p)
    assert 0.0 < np.abs(out["bristle"]).max() <= breakaway


def test_lost_commands_widen_the_prediction() -> None:
    one = case(NOISES["white"], n=100)
    _, sure = filtered(one)
    n = one.time_s.size
    out = np.zeros(n, linear_case.TICK)
    spans, current = np.full((n, 1), linear_case.PERIOD), one.current[:, None].copy()
    cell = one.measured / one.resolution
    samples = Samples(one.resolution, one.time_s, cell, np.arange(n) == 0, spans, current, np.full((n, 1), 50.0))
    linear_case.run_filter(linear_case.device(), one.noise, samples, out)
    added = out["vv"][1] - sure["vv"][1]
    assert added == pytest.approx((50.0 * linear_case.PERIOD) ** 2, rel=1e-6)
