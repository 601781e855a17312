from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import optimize

from hapticd.stability.criterion import lambda_
from hapticd.stability.devices import TABLE_II
from hapticd.stability.numbers import Loop
from hapticd.stability.regions import region
from hapticd.stability.tuning import (
    Start,
    grip_damping,
    margin,
    path,
    stiffness_max_dissipating,
    stiffness_max_passive,
)

RAW = 2.0 * math.pi / 8192
RE35 = Loop(6.28e-6, 9e-6, 2e-3, 0.012, 217 * RAW, 1e-3)


def test_passive_stiffness_is_the_smaller_of_eq_17_and_18() -> None:
    assert stiffness_max_passive(RE35) == pytest.approx(min(2 * 9e-6 / 1e-3, 2 * 2e-3 / (217 * RAW)))
    coarse = replace(RE35, resolution=2172 * RAW)
    assert stiffness_max_passive(coarse) == pytest.approx(2 * 2e-3 / (2172 * RAW))
    assert stiffness_max_passive(replace(RE35, viscous=0.0)) == 0.0
    assert stiffness_max_passive(replace(RE35, coulomb=0.0)) == 0.0


def test_delay_dither_and_converter_take_their_part_of_it() -> None:
    delayed = replace(RE35, delay=0.1e-3)
    K = stiffness_max_passive(delayed)
    assert pytest.approx(9e-6 / (1e-3 * float(lambda_(0.1)))) == K
    assert region(replace(delayed, stiffness=K).numbers) == "F1"
    assert region(replace(delayed, stiffness=K * (1.0 + 1e-9)).numbers) != "F1"
    coarse = replace(RE35, resolution=2172 * RAW, position_error=1.5, force_error=5e-4)
    assert stiffness_max_passive(coarse) == pytest.approx((2e-3 - 5e-4) / (2.0 * 2172 * RAW))
    assert stiffness_max_passive(replace(coarse, force_error=3e-3)) == 0.0
    assert stiffness_max_dissipating(replace(coarse, force_error=3e-3), Start(velocity=1.0)) == 0.0


@pytest.mark.parametrize("q", [0.5, 1.0])
def test_stiffness_for_a_hand_velocity_in_closed_form(q: float) -> None:
    # without delay (12) is linear in K: K = (bẋ + c)/(ẋT/2 + qΔ), if that is below c/(qΔ)
    omega = replace(TABLE_II[4].loop, position_error=q - 0.5)
    v = 0.3
    closed = (omega.viscous * v + omega.coulomb) / (v * omega.period / 2 + q * omega.resolution)
    found = stiffness_max_dissipating(omega, Start(velocity=v))
    assert found == pytest.approx(min(closed, omega.coulomb / (q * omega.resolution)), rel=1e-12)


@pytest.mark.parametrize("delay", [0.0, 0.07e-3, 1.25e-3])
@pytest.mark.parametrize("start", [Start(velocity=30.0), Start(deflection=0.5), Start(deflection=0.1, velocity=-10.0)])
@pytest.mark.parametrize("grip", [0.0, 0.01])
@pytest.mark.parametrize("force_error", [0.0, 3e-4])
def test_stiffness_margin_changes_sign_once_and_there(
    delay: float, start: Start, grip: float, force_error: float
) -> None:
    loop = replace(RE35, delay=delay, hand_stiffness=grip, force_error=force_error)
    K = stiffness_max_dissipating(loop, start)
    assert K > 0.0
    scan = np.geomspace(K * 1e-4, K * 1e3, 400)
    holds = np.array([margin(replace(loop, stiffness=k), start) >= 0.0 for k in scan])
    np.testing.assert_array_equal(holds, scan <= K)
    # the same root by another method
    hi = (2e-3 - force_error) / (loop.resolution * 0.5)
    if margin(replace(loop, stiffness=hi), start) < 0.0:
        other = optimize.brentq(lambda k: margin(replace(loop, stiffness=k), start), K * 1e-3, hi, xtol=1e-15)
        assert other == pytest.approx(K, rel=1e-9)


def test_without_coulomb_friction_no_stiffness_dissipates() -> None:
    assert stiffness_max_dissipating(replace(RE35, coulomb=0.0), Start(velocity=1.0)) == 0.0


def test_at_rest_at_the_origin_only_the_tick_counts() -> None:
    assert stiffness_max_dissipating(RE35, Start()) == pytest.approx(2 * 2e-3 / RE35.resolution)


def test_grip_takes_a_device_from_e_to_a() -> None:
    omega = TABLE_II[4].loop
    assert region(omega.numbers, 0.5) == "E"
    damping = grip_damping(omega)
    assert damping == pytest.approx(14500 / 6000 - 0.01)
    assert region(omega.with_hand(damping=damping * (1 + 1e-12)).numbers) == "A"
    assert grip_damping(RE35) == 0.0


def test_ways_of_fig_4() -> None:
    factors = np.array([1.0, 2.0, 4.0])
    n = RE35.numbers
    for parameter in ("stiffness", "period", "resolution"):
        beta, sigma = path(RE35, parameter, factors)
        for f, b, s in zip(factors, beta, sigma, strict=True):
            moved = replace(RE35, **{parameter: getattr(RE35, parameter) * f}).numbers
            assert (b, s) == (pytest.approx(moved.beta), pytest.approx(moved.sigma))
    beta, sigma = path(RE35, "stiffness", factors)
    np.testing.assert_allclose(sigma / beta, n.sigma / n.beta)
