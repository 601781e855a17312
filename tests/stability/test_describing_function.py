from __future__ import annotations

import itertools
import math

import mpmath
import numpy as np
import pytest
from scipy import integrate, optimize

from hapticd.stability.describing_function import (
    balance,
    device_response,
    encoder_gain,
    encoder_gain_small,
    frequency,
    large_frequency_series,
    large_sigma,
    large_sigma_series,
    nyquist,
    small_amplitude,
    small_sigma,
    stability_sigma,
)
from hapticd.stability.numbers import Dimensionless


@pytest.mark.parametrize("M", [0.02, 0.7, 1.0, 1.3, 2.0, 4.9, 17.5])
def test_encoder_gain_is_the_first_harmonic_of_the_quantiser(M: float) -> None:
    # D = (1/(πM)) ∫ (⌊M sin θ⌋ + ½) sin θ dθ over a turn, cut at every edge; fourfold symmetry
    edges = [0.0, *[math.asin(min(1.0, level / M)) for level in range(1, math.floor(M) + 1)], math.pi / 2]
    total = sum(
        integrate.quad(lambda t: (math.floor(M * math.sin(t)) + 0.5) * math.sin(t), a, b)[0]
        for a, b in itertools.pairwise(edges)
        if b > a
    )
    assert float(encoder_gain(M)) == pytest.approx(4.0 * total / (math.pi * M), rel=1e-9)


def test_encoder_gain_against_mpmath() -> None:
    for M in (0.5, 3.25, 123.456, 4321.5):
        m = mpmath.mpf(M)
        total = mpmath.fsum(mpmath.sqrt(m * m - k * k) for k in range(1, int(M) + 1))
        exact = 2 / (mpmath.pi * m) + 4 / (mpmath.pi * m * m) * total
        assert float(encoder_gain(M)) == pytest.approx(float(exact), rel=1e-12)


def test_encoder_gain_limits_of_fig_11b() -> None:
    M = np.array([0.1, 0.5, 1.0])
    np.testing.assert_allclose(encoder_gain(M), encoder_gain_small(M), rtol=1e-14)
    large = np.array([100.0, 1e4, 1e5, 1e7])
    assert np.all(np.abs(encoder_gain(large) - 1.0) < 2.0 * large**-1.5)
    assert encoder_gain(np.ones((2, 3))).shape == (2, 3)


def test_device_response_is_the_first_harmonic_of_the_force() -> None:
    # (64): force for ξ = M sin ωτ, expanded by quadrature
    M, w, mu, beta, sigma, kappa = 0.8, 0.3, 20.0, 0.7, 0.4, 0.2
    t = (np.arange(200_000) + 0.5) * 2 * np.pi / 200_000
    force = (kappa - mu * w * w) * M * np.sin(t) + beta * M * w * np.cos(t) + sigma * np.sign(np.cos(t))
    phasor = 2 * np.mean(force * np.sin(t)) + 2j * np.mean(force * np.cos(t))
    assert complex(device_response(M, w, mu, beta, sigma, kappa)) == pytest.approx(M / phasor, rel=1e-6)


@pytest.mark.parametrize(
    ("gain", "mu", "tau_l", "kappa"), [(1.0, 5.0, 0.5, 0.0), (300.0, 100.0, 1.75, 0.0), (1.0, 5.0, 0.5, 3.0)]
)
def test_frequency_solves_the_real_part(gain: float, mu: float, tau_l: float, kappa: float) -> None:
    other = optimize.brentq(lambda w: gain * math.cos(tau_l * w) - mu * w * w + kappa, 1e-9, math.pi / tau_l)
    assert float(frequency(gain, mu, tau_l, kappa)) == pytest.approx(other, rel=1e-10)


def test_a_very_stiff_hand_leaves_no_frequency() -> None:
    assert math.isnan(float(frequency(1.0, 0.1, 2.0, 50.0)))


def test_on_the_exact_cycle_eq_62_holds() -> None:
    mu, beta, tau_l, M = 5.0, 0.3, 0.75, 1.7
    # choose σ so that this M is a cycle, then look at the Nyquist curve itself
    omega, gain_without = balance(M, Dimensionless(mu, beta, 0.0, tau_l - 0.5))
    sigma = float(gain_without) * math.pi * M / 4.0
    curve = complex(nyquist(omega, mu, beta, tau_l, sigma, M))
    assert curve == pytest.approx(-1.0 / float(encoder_gain(M)), rel=1e-9)
    assert float(balance(M, Dimensionless(mu, beta, sigma, tau_l - 0.5))[1]) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("tau_l", [0.5, 1.75])
@pytest.mark.parametrize("beta", [0.0, 0.6])
def test_small_family_is_exact_below_one_tick(tau_l: float, beta: float) -> None:
    mu = 5.0
    for omega in np.linspace(0.4, 0.95, 6) * math.pi / (2 * tau_l):
        M = float(small_amplitude(omega, mu, tau_l))
        sigma = float(small_sigma(beta, omega, mu, tau_l))
        if not (0.0 < M < 1.0 and sigma > 0.0):
            continue
        assert sigma < 0.5
        w, gain = balance(M, Dimensionless(mu, beta, sigma, tau_l - 0.5))
        assert (float(w), float(gain)) == (pytest.approx(omega, rel=1e-9), pytest.approx(0.0, abs=1e-9))


def test_large_family_is_near_the_exact_one_above_one_tick() -> None:
    mu, tau_l = 5.0, 0.5
    for M in (10.4, 30.7):
        sigma = float(large_sigma(0.2, M, mu, tau_l))
        _, gain = balance(M, Dimensionless(mu, 0.2, sigma, tau_l - 0.5))
        assert abs(float(gain)) < 0.01
        assert sigma == pytest.approx(
            math.pi
            * M
            / 4
            * (math.sin(tau_l * float(frequency(1.0, mu, tau_l))) - 0.2 * float(frequency(1.0, mu, tau_l))),
            rel=1e-12,
        )


def test_series_of_eq_73_to_75() -> None:
    for mu in (50.0, 500.0):
        omega = float(frequency(1.0, mu, 0.5))
        assert large_frequency_series(mu, 0.5) == pytest.approx(omega, rel=1.0 / mu**2)
        exact, series = float(large_sigma(0.1, 1.0, mu, 0.5)), float(large_sigma_series(0.1, 1.0, mu, 0.5))
        assert series == pytest.approx(exact, rel=0.1 / mu)
        assert float(stability_sigma(0.1, mu, 0.5)) == pytest.approx(series, rel=0.2 / mu)
