"""Motion with its energies against quadrature, mpmath and an ODE solver."""

from __future__ import annotations

import itertools
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import integrate

from hapticd.plant.exact import propagate
from hapticd.plant.spring import propagate_with_stiffness
from hapticd.stability.segments import glide_with_square, move

unit = st.floats(-1.0, 1.0)
positive = st.floats(1e-3, 1e3)
friction = st.one_of(st.just(0.0), st.floats(1e-9, 1e2))


def reference(v: float, dt: float, g: float, rate: float) -> Any:
    """Way, end velocity and ∫v² of v′ = g − rate·v in 60 digits."""
    with mpmath.workdps(60):
        v, dt, g, rate = (mpmath.mpf(a) for a in (v, dt, g, rate))
        if rate == 0:
            return v * dt + g * dt**2 / 2, v + g * dt, v**2 * dt + v * g * dt**2 + g**2 * dt**3 / 3
        a, b = v - g / rate, g / rate  # v(s) = a·exp(−rate·s) + b
        once, twice = (1 - mpmath.exp(-rate * dt)) / rate, (1 - mpmath.exp(-2 * rate * dt)) / (2 * rate)
        return a * once + b * dt, a * mpmath.exp(-rate * dt) + b, a * a * twice + 2 * a * b * once + b * b * dt


@settings(max_examples=400, deadline=None)
@given(st.floats(0.0, 10.0), positive, st.floats(-5.0, 5.0), st.floats(-13.0, 2.0))
@example(1.0, 1.0, 1.0, -0.301)  # rate·dt beside the switch from series to closed form
@example(0.0, 1.0, 1.0, -0.884765625)
def test_integrals_of_one_piece_have_all_their_digits(v: float, dt: float, g: float, log_rate: float) -> None:
    rate = 10.0**log_rate / dt
    *found, time = glide_with_square(v, dt, g, rate)
    exact = reference(v, time, g, rate)
    assert time == dt or found[1] == 0.0
    drive = abs(g) * dt
    scales = ((v + drive) * dt, v + drive, (v + drive) ** 2 * dt)
    for value, truth, scale in zip(found, exact, scales, strict=True):
        assert abs(value - float(truth)) <= 4e-15 * scale + 1e-300


@settings(max_examples=300, deadline=None)
@given(unit, st.floats(-5.0, 5.0), st.floats(0.0, 5.0), st.floats(-5.0, 5.0), positive, friction, friction)
def test_moves_as_the_plant_does(x: float, v: float, dt: float, force: float, m: float, b: float, c: float) -> None:
    position, velocity, drag, path, low, high = move(x, v, dt, force, m, b, c, 0.0)
    expected = propagate(x, v, dt, force, m, b, c)
    scale = max(1.0, abs(expected[0]), abs(expected[1]))
    assert (position, velocity) == pytest.approx(expected, rel=1e-12, abs=1e-13 * scale)
    assert low <= min(x, position)
    assert high >= max(x, position)
    assert path >= high - low - 1e-12 * scale
    assert drag >= 0.0
    work, gained = force * (position - x), 0.5 * m * (velocity - v) * (velocity + v)
    scale = 0.5 * m * v * v + abs(force) * (abs(x) + path) + drag + c * path
    assert abs(gained + drag + c * path - work) <= 1e-12 * scale + 1e-300


@pytest.mark.parametrize(
    ("x", "v", "dt", "force", "m", "b", "c", "k"),
    [
        (0.3, 2.0, 3.0, -1.5, 1.0, 0.4, 0.5, 0.0),  # stops and reverses
        (0.3, 2.0, 3.0, -0.2, 1.0, 0.4, 0.5, 0.0),  # stops and sticks
        (0.0, 0.0, 2.0, 1.1, 2.0, 0.0, 0.3, 0.0),  # breaks loose
        (1.0, 0.0, 9.0, 0.0, 1.0, 0.1, 0.05, 3.0),  # swings on a hand's spring until it sticks
        (-2.0, 1.0, 2.0, 0.7, 1.0, 9.0, 0.2, 1.5),  # overdamped
    ],
)
def test_friction_energies_against_quadrature(
    x: float, v: float, dt: float, force: float, m: float, b: float, c: float, k: float
) -> None:
    def velocity(t: float) -> float:
        return float(propagate_with_stiffness(x, v, t, force, m, b, c, k)[1])

    grid = np.linspace(0.0, dt, 4001)
    speeds = np.array([velocity(t) for t in grid])
    kinks = grid[1:-1][(speeds[1:-1] * speeds[2:] <= 0.0) & (speeds[1:-1] != 0.0)]
    edges = np.concatenate(([0.0], kinks, kinks + dt / 4000, [dt]))
    edges.sort()
    pieces = list(itertools.pairwise(edges))
    square = sum(integrate.quad(lambda t: velocity(t) ** 2, a, z, epsabs=1e-12)[0] for a, z in pieces)
    way = sum(integrate.quad(lambda t: abs(velocity(t)), a, z, epsabs=1e-12)[0] for a, z in pieces)
    *_, drag, path, low, high = move(x, v, dt, force, m, b, c, k)
    places = np.array([propagate_with_stiffness(x, v, t, force, m, b, c, k)[0] for t in grid])
    assert drag == pytest.approx(b * square, rel=1e-7, abs=1e-12)
    assert path == pytest.approx(way, rel=1e-6)
    assert (low, high) == pytest.approx((places.min(), places.max()), abs=1e-5)
    assert low <= places.min() + 1e-12
    assert high >= places.max() - 1e-12


def test_a_hands_spring_against_an_ode_solver() -> None:
    m, b, k, force = 1.3, 0.2, 2.5, 0.4  # no Coulomb friction: a smooth problem

    def rates(_: float, y: Any) -> Any:
        return [y[1], (force - b * y[1] - k * y[0]) / m, b * y[1] ** 2]

    solved = integrate.solve_ivp(rates, (0.0, 7.0), [0.5, 1.0, 0.0], rtol=1e-12, atol=1e-13, method="DOP853")
    x, v, drag, *_ = move(0.5, 1.0, 7.0, force, m, b, 0.0, k)
    assert (x, v, drag) == pytest.approx(tuple(solved.y[:, -1]), rel=1e-9)
