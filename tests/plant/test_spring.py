"""The exact step with an operator's grip: every damping case, every stop, and the limits that lose digits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hapticd.plant.exact import propagate
from hapticd.plant.spring import propagate_with_stiffness
from tests.plant.reference import exact_reference

Case = tuple[float, float, float, float, float, float, float, float]


def error(case: Case) -> float:
    """Error relative to what position and speed the forces can reach, per radian of oscillation."""
    x, v, dt, force, inertia, viscous, coulomb, stiffness = case
    got, expected = propagate_with_stiffness(*case), exact_reference(*case)
    omega = math.sqrt(stiffness / inertia)
    time = min(dt, 1.0 / omega)
    braked = min(time, inertia / viscous) if viscous else time
    speed = abs(v) + (abs(force) + coulomb + stiffness * abs(x)) / inertia * braked
    length = abs(x) + speed * time
    return max(abs(float(got[0] - expected[0])) / length, abs(float(got[1] - expected[1])) / speed) / (1.0 + dt * omega)


@pytest.mark.parametrize("ratio", [0.0, 1e-9, 0.1, 0.9, 1 - 1e-4, 1 - 1e-12, 1.0, 1 + 1e-15, 1 + 1e-8, 1.1, 5.0, 1e4])
@pytest.mark.parametrize("dt", [1e-4, 0.3, 2.0, 40.0])
def test_every_damping_ratio_to_the_last_digits(ratio: float, dt: float) -> None:
    inertia, stiffness = 2.0, 3.0
    viscous = ratio * 2.0 * math.sqrt(inertia * stiffness)
    for v, force, coulomb in [(0.0, 5.0, 0.1), (1.5, 0.0, 0.0), (1.5, -4.0, 0.5), (-1.5, 0.3, 0.2)]:
        assert error((0.4, v, dt, force, inertia, viscous, coulomb, stiffness)) < 2e-15


@pytest.mark.parametrize("stiffness", [1e-15, 1e-9, 1e-4, 1e-1])
@pytest.mark.parametrize("viscous", [0.0, 1e-12, 0.75, 300.0])
def test_a_weak_spring_loses_no_digits(stiffness: float, viscous: float) -> None:
    for v, force, coulomb in [(0.0, 5.0, 0.1), (1.5, -4.0, 0.5)]:
        for dt in (0.1, 1.0, 50.0):
            assert error((0.4, v, dt, force, 100.0, viscous, coulomb, stiffness)) < 2e-15


def test_random_cases_agree_with_60_digits() -> None:
    random = np.random.default_rng(21)
    worst = 0.0
    for _ in range(600):
        inertia, stiffness = 10 ** random.uniform(-1, 4), 10 ** random.uniform(-9, 2)
        dt = min(10 ** random.uniform(-4, 3), 100.0 / math.sqrt(stiffness / inertia))
        viscous, coulomb = (
            random.choice([0.0, 10 ** random.uniform(-9, 2)]),
            random.choice([0.0, 10 ** random.uniform(-3, 2)]),
        )
        x, v, force = random.normal(size=3) * 10 ** random.uniform(-3, 2, size=3)
        worst = max(worst, error((x, v, dt, force, inertia, viscous, coulomb, stiffness)))
    assert worst < 1e-14


def test_without_stiffness_it_is_the_plain_step_to_the_bit() -> None:
    arguments = (0.3, -2.0, 1.7, 4.0, 5.0, 0.6, 0.7)
    assert propagate_with_stiffness(*arguments, 0.0) == propagate(*arguments)


def test_stiction_holds_where_spring_and_force_are_within_friction() -> None:
    assert propagate_with_stiffness(0.25, 0.0, 1e6, 1.5, 2.0, 0.1, 1.0, 10.0) == (0.25, 0.0)
    assert propagate_with_stiffness(0.25, 0.0, 1e-3, 1.4999, 2.0, 0.1, 1.0, 10.0)[1] < 0.0


def test_coulomb_friction_takes_the_same_amplitude_off_every_half_swing() -> None:
    inertia, stiffness, coulomb, start = 2.0, 8.0, 0.1, 1.03
    half_period = math.pi * math.sqrt(inertia / stiffness)
    loss = 2.0 * coulomb / stiffness
    for half_swings in range(1, 35):
        x, v = propagate_with_stiffness(start, 0.0, half_swings * half_period, 0.0, inertia, 0.0, coulomb, stiffness)
        assert x == pytest.approx((-1) ** half_swings * (start - half_swings * loss), abs=1e-13)
        assert v == pytest.approx(0.0, abs=1e-13)


def test_swings_until_stiction_holds_it() -> None:
    x, v = propagate_with_stiffness(1.03, 0.0, 1e12, 0.0, 2.0, 0.0, 0.1, 8.0)
    assert v == 0.0
    assert abs(8.0 * x) <= 0.1


def test_free_swing_has_no_stops_and_keeps_its_energy() -> None:
    x, v = propagate_with_stiffness(0.7, 0.2, 1e4, 0.0, 2.0, 0.0, 0.0, 8.0)
    assert 4.0 * x * x + v * v == pytest.approx(4.0 * 0.49 + 0.04, rel=1e-12)


@pytest.mark.parametrize("ratio", [0.0, 1e-12, 1e-4, 1e-3, 0.02])
@pytest.mark.parametrize("dt", [99.0, 101.0, 900.0])
def test_hundreds_of_swings_lose_no_digits(ratio: float, dt: float) -> None:
    for x, v, force, coulomb in [(1.0, 0.0, 0.0, 1e-4), (-0.3, 0.8, 0.2, 1e-3), (0.7, -0.1, -0.3, 7e-3)]:
        assert error((x, v, dt, force, 1.0, 2.0 * ratio, coulomb, 1.0)) < 2e-15


@pytest.mark.timeout(20)
@pytest.mark.parametrize("inertia", [1.0, 1e-20, 1e-40, 1e-300])
@pytest.mark.parametrize("dt", [1e12, 1e100, math.inf])
def test_a_thousand_million_swings_end_in_stiction(inertia: float, dt: float) -> None:
    x, v = propagate_with_stiffness(1.0, 0.0, dt * math.sqrt(inertia), 0.0, inertia, 0.0, 1e-9, 1.0)
    assert v == 0.0
    assert abs(x) <= 1e-9


@pytest.mark.timeout(20)
@pytest.mark.parametrize("coulomb", [5e-324, 1e-300, 1e-12, 1.0])
@pytest.mark.parametrize("x", [1.0, 1e10, 1e300])
@pytest.mark.parametrize("viscous", [0.0, 1e-12, 1.0, 2.0 - 1e-15, 1e12])
@pytest.mark.parametrize("dt", [1e18, 1e300, math.inf])
def test_no_swing_is_followed_for_ever(coulomb: float, x: float, viscous: float, dt: float) -> None:
    end, _ = propagate_with_stiffness(x, 0.0, dt, x - 0.3, 1.0, viscous, coulomb, 1.0)
    assert not abs(end) > 3.0 * x  # not a number where coulomb and dt leave double precision together


@pytest.mark.parametrize("place", range(8))
def test_not_a_number_is_not_hidden(place: int) -> None:
    arguments = [0.1, 1.0, 1.0, 0.5, 2.0, 0.3, 0.1, 4.0]
    arguments[place] = math.nan
    assert math.isnan(propagate_with_stiffness(*arguments)[0])
