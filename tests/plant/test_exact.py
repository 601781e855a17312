"""The exact step against closed forms: textbook solutions, and the same equations at 60 digits."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest

from hapticd.plant.exact import phi_functions, propagate, time_and_distance_to_rest
from tests.plant.reference import exact_reference, relative_error

MU, BETA, SIGMA = 523.0, 0.75, 1.0


def test_without_friction_it_is_the_parabola() -> None:
    assert propagate(1.0, 2.0, 3.0, 4.0, 5.0, 0.0, 0.0) == pytest.approx(
        (1 + 6 + 0.5 * 0.8 * 9, 2 + 0.8 * 3), rel=1e-15
    )


def test_viscous_friction_alone_is_an_exponential() -> None:
    x, v = propagate(0.5, 3.0, 2.0, 0.0, 4.0, 1.5, 0.0)
    assert v == pytest.approx(3.0 * math.exp(-0.75), rel=1e-14)
    assert x == pytest.approx(0.5 + 3.0 * 4.0 / 1.5 * (1 - math.exp(-0.75)), rel=1e-14)


def test_coulomb_friction_alone_stops_after_its_braking_distance_and_holds() -> None:
    assert propagate(0.0, 2.0, 100.0, 0.0, 5.0, 0.0, 0.5) == pytest.approx((20.0, 0.0), rel=1e-15, abs=0.0)


def test_a_force_above_friction_reverses_the_mass() -> None:
    x, v = propagate(0.0, 1.0, 2.0, -3.0, 1.0, 0.0, 1.0)
    stop = 1.0 / 4.0
    assert x == pytest.approx(1.0 / 8.0 - 0.5 * 2.0 * (2.0 - stop) ** 2, rel=1e-14)
    assert v == pytest.approx(-2.0 * (2.0 - stop), rel=1e-14)


def test_constant_force_ends_at_the_terminal_velocity() -> None:
    _, v = propagate(0.0, 0.0, 1e9, 5.0, 2.0, 0.5, 1.0)
    assert v == pytest.approx((5.0 - 1.0) / 0.5, rel=1e-15)


@pytest.mark.parametrize("force", [-1.0, -0.3, 0.0, 0.999, 1.0])
def test_stiction_holds_exactly_up_to_the_coulomb_force(force: float) -> None:
    assert propagate(0.123456789, 0.0, 1e6, force, MU, BETA, 1.0) == (0.123456789, 0.0)


@pytest.mark.parametrize("force", [np.nextafter(1.0, 2.0), -1.5])
def test_a_force_above_the_coulomb_force_breaks_away_in_its_direction(force: float) -> None:
    _, v = propagate(0.0, 0.0, 1.0, force, MU, BETA, 1.0)
    assert v * force > 0.0


def test_a_mass_without_coulomb_friction_and_force_keeps_still_and_keeps_moving() -> None:
    assert propagate(2.0, 0.0, 5.0, 0.0, MU, BETA, 0.0) == (2.0, 0.0)
    assert propagate(2.0, 0.5, 4.0, 0.0, MU, 0.0, 0.0) == (4.0, 0.5)


def test_no_time_changes_nothing() -> None:
    assert propagate(1.25, -3.5, 0.0, 7.0, MU, BETA, SIGMA) == (1.25, -3.5)
    assert propagate(1.25, 0.0, 0.0, 7.0, MU, BETA, SIGMA) == (1.25, 0.0)


@pytest.mark.parametrize("place", range(7))
def test_not_a_number_is_not_hidden(place: int) -> None:
    arguments = [0.1, 1.0, 1.0, 0.5, MU, BETA, SIGMA]
    arguments[place] = math.nan
    assert math.isnan(propagate(*arguments)[0])


@pytest.mark.parametrize("beta", [0.0, *(10.0**-k for k in range(1, 16)), 1e-20])
@pytest.mark.parametrize(("v", "force"), [(0.0, 1.7), (3.0, 0.2), (3.0, 5.0), (0.01, -0.5), (0.01, -20.0), (-3.0, 0.0)])
def test_small_viscous_friction_loses_no_digits(beta: float, v: float, force: float) -> None:
    for dt in (1e-3, 1.0, 30.0):
        arguments = (0.25, v, dt, force, 100.0, beta, SIGMA)
        assert relative_error(propagate(*arguments), exact_reference(*arguments), 0.25, v, dt) < 1e-14


@pytest.mark.parametrize("damping", [0.0624, 0.0626, 0.999, 1.001, 10.0, 1e3, 1e8, 1e200])
@pytest.mark.parametrize(("v", "force"), [(0.0, 1.7), (3.0, 0.2), (3.0, 5.0), (3.0, -20.0), (-1.0, 0.0)])
def test_large_viscous_friction_neither_overflows_nor_loses_digits(damping: float, v: float, force: float) -> None:
    arguments = (0.25, v, 1.0, force, 1.0, damping, SIGMA)
    assert relative_error(propagate(*arguments), exact_reference(*arguments), 0.25, v, 1.0) < 1e-12


@pytest.mark.parametrize("beta", [0.0, 1e-12, 0.75, 100.0])
@pytest.mark.parametrize("force", [0.2, -0.9, -4.0])
@pytest.mark.parametrize("offset", [0.0, 1e-15, -1e-15, 1e-12, -1e-12, 1e-6, -1e-6])
def test_a_stop_next_to_the_end_of_the_step_loses_no_digits(beta: float, force: float, offset: float) -> None:
    v, mu = 0.37, 50.0
    braking = SIGMA - force
    stop = mu * v / braking if beta == 0.0 else mu / beta * math.log1p(beta * v / braking)
    dt = stop * (1.0 + offset)
    arguments = (-0.2, v, dt, force, mu, beta, SIGMA)
    assert relative_error(propagate(*arguments), exact_reference(*arguments), -0.2, v, dt) < 2e-15


def test_random_cases_agree_with_60_digits_to_1e_12() -> None:
    random = np.random.default_rng(20)
    worst = 0.0
    for _ in range(3000):
        arguments = (
            float(random.choice([0.0, random.normal() * 10 ** random.uniform(-3, 2)])),
            float(random.choice([0.0, random.normal() * 10 ** random.uniform(-6, 2)])),
            float(10 ** random.uniform(-6, 4)),
            float(random.choice([0.0, random.normal() * 10 ** random.uniform(-3, 2)])),
            float(10 ** random.uniform(-1, 4)),
            float(random.choice([0.0, 10 ** random.uniform(-15, 3), 10 ** random.uniform(-2, 1)])),
            float(random.choice([0.0, 10 ** random.uniform(-3, 2)])),
        )
        worst = max(worst, relative_error(propagate(*arguments), exact_reference(*arguments), *arguments[:3]))
    assert worst < 1e-12


@pytest.mark.parametrize("z", [0.0, 1e-300, 1e-15, 1e-9, 1e-3, 0.0624, 0.0626, 0.3, 0.999, 1.001, 30.0, 700.0, 1e4])
def test_phi_functions_to_the_last_digits(z: float) -> None:
    with mp.workdps(650):
        exact = (mp.exp(-z), mp.mpf(1), mp.mpf(1) / 2)
        if z:
            exact = (mp.exp(-z), -mp.expm1(-z) / z, (mp.expm1(-z) + z) / mp.mpf(z) ** 2)
        errors = [abs(float(got / want - 1)) for got, want in zip(phi_functions(-z)[1:], exact[1:], strict=True)]
        assert max(errors) < 1e-14
        assert abs(phi_functions(-z)[0] - float(exact[0])) < 1e-15


@pytest.mark.parametrize("w", [1e-300, 1e-15, 1e-9, 1e-3, 0.1249, 0.1251, 1.0, 1e4, 1e300])
@pytest.mark.parametrize("speed", [1.0, 37.0])
def test_time_and_distance_to_rest_to_the_last_digits(w: float, speed: float) -> None:
    with mp.workdps(650):
        rate = mp.mpf(w) / speed * 0.5
        time = mp.log1p(w) / rate
        exact = (time, (speed - 0.5 * time) / rate) if w < 1e300 else (time, speed / rate)
        got = time_and_distance_to_rest(speed, 0.5, w * 0.5 / speed)
        assert max(abs(float(value / want - 1)) for value, want in zip(got, exact, strict=True)) < 1e-14


@pytest.mark.parametrize("coulomb", [5e-324, 1e-310, 1e-300])
def test_friction_too_small_to_matter_leaves_the_exponential(coulomb: float) -> None:
    assert propagate(0.5, 2.0, 1e6, 0.0, 3.0, 1.0, coulomb) == pytest.approx((6.5, 0.0), rel=1e-15, abs=0.0)
