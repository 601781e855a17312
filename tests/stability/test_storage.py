from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate

from hapticd.stability.storage import (
    equivalent_deflection,
    equivalent_velocity,
    potential,
    rho,
    storage,
    velocity_bound,
)


@pytest.mark.parametrize("xi", [0.0, 0.3, 0.999, 1.0, 7.25, -0.2, -1.0, -6.6])
def test_potential_is_the_integral_of_the_quantised_force(xi: float) -> None:
    edges = [e for e in range(-8, 9) if min(0.0, xi) < e < max(0.0, xi)]
    value, _ = integrate.quad(lambda x: math.floor(x) + 0.5, 0.0, xi, points=edges or None, limit=200)
    assert float(potential(xi)) == pytest.approx(value, abs=1e-12)


@given(st.floats(-1e4, 1e4))
def test_potential_is_eq_34(xi: float) -> None:
    r = float(rho(xi))
    assert 0.0 <= r <= 1.0  # exactly 1 only by rounding, just below a tick
    assert float(potential(xi)) == pytest.approx(0.5 * xi * xi + 0.5 * (r - r * r), rel=1e-12, abs=1e-12)


def test_first_numbers_of_the_counterexample_in_the_notes() -> None:
    # μ = 100, ξ = 0.99, ξ̇ = 0.5: H_T = 12.5 + 0.495
    assert float(storage(0.99, 0.5, 100.0)) == pytest.approx(12.995, abs=1e-12)


def test_hand_spring_stores_energy_too() -> None:
    assert float(storage(2.0, 0.0, 10.0, kappa=0.5) - storage(2.0, 0.0, 10.0)) == pytest.approx(1.0)


@given(st.floats(0.0, 1e3), st.floats(0.1, 1e4))
def test_release_and_its_equivalent_velocity_carry_the_same_energy(xi: float, mu: float) -> None:
    velocity = float(equivalent_velocity(xi, mu))
    assert float(storage(0.0, velocity, mu)) == pytest.approx(float(storage(xi, 0.0, mu)), rel=1e-12, abs=1e-300)
    assert float(equivalent_deflection(velocity, mu)) == pytest.approx(xi, rel=1e-9, abs=1e-9)


def test_equivalent_velocity_keeps_the_rho_term() -> None:
    # case a of Fig. 8: ½·20.3² + ½(0.3 − 0.09) = 206.15
    assert float(equivalent_velocity(20.3, 523.333)) == pytest.approx(math.sqrt(2 * 206.15 / 523.333), rel=1e-9)


def test_velocity_bound_is_the_initial_velocity_at_the_origin() -> None:
    assert float(velocity_bound(0.0, -7.3, 100.0)) == 7.3
    assert float(velocity_bound(5.5, 0.0, 100.0)) == pytest.approx(float(equivalent_velocity(5.5, 100.0)))


def test_velocity_bound_includes_the_coasting_before_the_first_force() -> None:
    # after τ_D = 2 at 3 ticks a period: 6 ticks from the origin, 18 units of potential
    assert float(velocity_bound(0.0, 3.0, 100.0, 2.0)) == pytest.approx(math.sqrt(9.0 + 2.0 * 18.0 / 100.0))


def test_everything_broadcasts() -> None:
    grid = storage(np.zeros((3, 1)), np.ones((1, 4)), np.full((3, 4), 2.0))
    np.testing.assert_array_equal(grid, np.ones((3, 4)))
