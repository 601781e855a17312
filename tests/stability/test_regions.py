from __future__ import annotations

import math

import numpy as np
import pytest

from hapticd.stability.criterion import coulomb_margin, criterion_margin, dissipation_margin, lambda_, viscous_margin
from hapticd.stability.numbers import Dimensionless, Loop
from hapticd.stability.regions import MEANING, critical_sigma, region
from hapticd.stability.storage import velocity_bound


@pytest.mark.parametrize(
    ("beta", "sigma", "velocity", "name"),
    [
        (0.6, 0.6, None, "A"),
        (0.6, 0.6, 1e9, "A"),
        (0.5, 0.5, 50.0, "A"),
        (0.6, 0.4, None, "B"),
        (0.4, 0.4, 10.0, "C"),
        (0.4, 1.0, None, "D|E"),
        (0.4, 1.0, 4.99, "E"),  # (15): (1 − ½)/(½ − 0.4) = 5
        (0.4, 1.0, 5.01, "D"),
    ],
)
def test_regions_without_delay(beta: float, sigma: float, velocity: float | None, name: str) -> None:
    assert region(Dimensionless(100.0, beta, sigma), velocity) == name


@pytest.mark.parametrize(
    ("beta", "sigma", "velocity", "name"),
    [
        (1.8, 0.6, None, "F1"),  # λ(1.25) = 1.776
        (1.8, 0.6, 1e9, "F1"),
        (1.76, 0.6, None, "F1|F2"),
        (1.76, 0.6, 6.0, "F1"),
        (1.76, 0.6, 7.0, "F2"),
        (1.8, 0.4, None, "B"),
        (1.7, 0.4, None, "C"),
        (0.6, 3.0, None, "D|E"),
        (0.6, 3.0, 1.0, "E"),
        (0.6, 3.0, 5.0, "D"),
    ],
)
def test_regions_with_delay(beta: float, sigma: float, velocity: float | None, name: str) -> None:
    assert region(Dimensionless(100.0, beta, sigma, 1.25), velocity) == name


@pytest.mark.parametrize(
    ("rate", "decimation", "deflection", "name"),
    [(1000, 217, 20.3, "A"), (1000, 2172, 3.3, "B"), (100, 217, 2.3, "E"), (100, 217, 10.3, "D")],
)
def test_the_four_cases_of_fig_8(rate: float, decimation: int, deflection: float, name: str) -> None:
    n = Loop(6.28e-6, 9e-6, 2e-3, 0.012, 2.0 * math.pi / 8192 * decimation, 1.0 / rate).numbers
    assert region(n, float(velocity_bound(deflection, 0.0, n.mu))) == name


def test_no_spring_is_passive() -> None:
    assert region(Loop(1.0, 0.0, 0.0, 0.0, 1.0, 1.0).numbers) == "A"
    assert region(Loop(1.0, 0.0, 0.0, 0.0, 1.0, 1.0, delay=2.0).numbers, 3.0) == "F1"
    assert criterion_margin(Loop(1.0, 0.0, 0.0, 0.0, 1.0, 1.0, delay=2.0).numbers, 3.0) == math.inf


@pytest.mark.parametrize("velocity", [-1.0, math.nan])
def test_a_velocity_must_be_a_velocity(velocity: float) -> None:
    with pytest.raises(ValueError, match="xi_dot_max"):
        region(Dimensionless(100.0, 0.4, 1.0), velocity)


def test_margins_are_distances_to_the_lines() -> None:
    n = Dimensionless(100.0, 0.4, 1.0)
    assert viscous_margin(n) == pytest.approx(-0.1)
    assert coulomb_margin(n) == pytest.approx(0.5)
    assert criterion_margin(n, 3.0) == pytest.approx(0.5 - 3.0 * 0.1)


@pytest.mark.parametrize("tau_d", [0.0, 0.4, 1.25])
@pytest.mark.parametrize("beta", [0.0, 0.4, 1.2, 2.5])
def test_on_the_critical_line_the_margin_vanishes(beta: float, tau_d: float) -> None:
    sigma = critical_sigma(Dimensionless(100.0, 0.1, 0.1, tau_d), 7.0, beta)
    assert float(dissipation_margin(beta, sigma, tau_d, 7.0)) == pytest.approx(0.0, abs=1e-12)


def test_a_coarser_force_moves_the_borders() -> None:
    n = Dimensionless(100.0, 0.6, 0.9, quantum=1.0)
    assert region(n) == "B"
    assert critical_sigma(n, 7.0, 0.6) == 1.0


def test_every_name_is_explained() -> None:
    assert set(MEANING) == {"A", "B", "C", "D", "E", "F1", "F2", "D|E", "F1|F2"}


def test_the_viscous_boundary_with_delay_is_not_decided_by_rounding() -> None:
    for tau_d in np.random.default_rng(1).uniform(0.01, 2.0, 2000):
        assert region(Dimensionless(100.0, 0.5 + tau_d, 2.0, tau_d)) == "F1|F2"
        assert region(Dimensionless(100.0, float(lambda_(tau_d)), 2.0, tau_d)) == "F1"
