"""What must hold of every motion, and the motion against scipy's solve_ivp with events, on random cases."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hapticd.plant.exact import propagate
from hapticd.plant.spring import propagate_with_stiffness
from tests.plant.reference import integrate

signed = st.floats(-10.0, 10.0).map(lambda value: 0.0 if abs(value) < 1e-3 else value)
positions = signed
velocities = st.one_of(st.just(0.0), signed)
forces = st.one_of(st.just(0.0), signed)
inertias = st.floats(0.5, 1000.0)
viscous = st.one_of(st.just(0.0), st.floats(1e-9, 1e-3), st.floats(1e-3, 5.0))
coulomb = st.one_of(st.just(0.0), st.floats(1e-3, 5.0))
durations = st.floats(0.01, 10.0)
stiffnesses = st.one_of(st.just(0.0), st.floats(1e-6, 20.0))

many = settings(max_examples=300, deadline=None)


def scale(x: float, v: float, dt: float, force: float, inertia: float, coulomb: float) -> float:
    return max(abs(x), abs(v) * dt, (abs(force) + coulomb) * dt * dt / inertia)


@settings(max_examples=120, deadline=None)
@given(positions, velocities, durations, forces, inertias, viscous, coulomb)
def test_agrees_with_solve_ivp(
    x: float, v: float, dt: float, force: float, inertia: float, viscous: float, coulomb: float
) -> None:
    got = propagate(x, v, dt, force, inertia, viscous, coulomb)
    expected = integrate(x, v, dt, force, inertia, viscous, coulomb)
    size = scale(x, v, dt, force, inertia, coulomb)
    assert got[0] == pytest.approx(expected[0], abs=1e-9 * size + 1e-11)
    assert got[1] == pytest.approx(expected[1], abs=1e-9 * size / dt + 1e-11)


@settings(max_examples=80, deadline=None)
@given(positions, velocities, durations, forces, inertias, viscous, coulomb, stiffnesses)
def test_with_a_spring_agrees_with_solve_ivp(
    x: float, v: float, dt: float, force: float, inertia: float, viscous: float, coulomb: float, stiffness: float
) -> None:
    # Where a stop lies within the integrator's tolerance of the stiction limit, the two may rightly part.
    assume(stiffness == 0.0 or coulomb == 0.0 or abs(abs(force - stiffness * x) - coulomb) > 1e-6)
    got = propagate_with_stiffness(x, v, dt, force, inertia, viscous, coulomb, stiffness)
    expected = integrate(x, v, dt, force, inertia, viscous, coulomb, stiffness)
    speed = abs(v) + (abs(force) + coulomb + stiffness * abs(x)) * dt / inertia
    assert got[0] == pytest.approx(expected[0], abs=1e-8 * (abs(x) + speed * dt) + 1e-11)
    assert got[1] == pytest.approx(expected[1], abs=1e-8 * speed * (1.0 + dt * math.sqrt(stiffness / inertia)) + 1e-10)


@many
@given(positions, velocities, durations, st.floats(0.0, 1.0), forces, inertias, viscous, coulomb)
def test_two_steps_are_one(
    x: float, v: float, dt: float, share: float, force: float, inertia: float, viscous: float, coulomb: float
) -> None:
    whole = propagate(x, v, dt, force, inertia, viscous, coulomb)
    first = dt * share
    middle = propagate(x, v, first, force, inertia, viscous, coulomb)
    parts = propagate(*middle, dt - first, force, inertia, viscous, coulomb)
    size = scale(x, v, dt, force, inertia, coulomb)
    assert parts[0] == pytest.approx(whole[0], abs=1e-12 * size)
    assert parts[1] == pytest.approx(whole[1], abs=1e-12 * size / dt + 1e-13 * abs(v))


@many
@given(positions, velocities, durations, st.floats(0.0, 1.0), forces, inertias, viscous, coulomb, stiffnesses)
def test_two_steps_are_one_with_a_spring(
    x: float,
    v: float,
    dt: float,
    share: float,
    force: float,
    inertia: float,
    viscous: float,
    coulomb: float,
    stiffness: float,
) -> None:
    constants = (force, inertia, viscous, coulomb, stiffness)
    whole = propagate_with_stiffness(x, v, dt, *constants)
    parts = propagate_with_stiffness(
        *propagate_with_stiffness(x, v, dt * share, *constants), dt - dt * share, *constants
    )
    speed = abs(v) + (abs(force) + coulomb + stiffness * abs(x)) * dt / inertia
    turns = 1.0 + dt * math.sqrt(stiffness / inertia)
    assert parts[0] == pytest.approx(whole[0], abs=1e-12 * (abs(x) + speed * dt) * turns)
    assert parts[1] == pytest.approx(whole[1], abs=1e-12 * speed * turns)


@many
@given(positions, velocities, durations, forces, inertias, viscous, coulomb)
def test_left_and_right_are_alike_to_the_bit(
    x: float, v: float, dt: float, force: float, inertia: float, viscous: float, coulomb: float
) -> None:
    right = propagate(x, v, dt, force, inertia, viscous, coulomb)
    left = propagate(-x, -v, dt, -force, inertia, viscous, coulomb)
    assert left == (-right[0], -right[1])


@many
@given(positions, velocities, durations, forces, inertias, viscous, coulomb)
def test_no_step_makes_energy(
    x: float, v: float, dt: float, force: float, inertia: float, viscous: float, coulomb: float
) -> None:
    end, end_speed = propagate(x, v, dt, force, inertia, viscous, coulomb)
    before, after = 0.5 * inertia * v * v, 0.5 * inertia * end_speed * end_speed
    work = force * (end - x)
    slack = 1e-13 * (before + after + abs(force) * (abs(x) + abs(end)))
    assert after - before <= work + slack
    if force == 0.0:
        assert abs(end_speed) <= abs(v)


@many
@given(positions, velocities, durations, forces, inertias)
def test_without_friction_time_can_be_reversed(x: float, v: float, dt: float, force: float, inertia: float) -> None:
    end, end_speed = propagate(x, v, dt, force, inertia, 0.0, 0.0)
    back, back_speed = propagate(end, -end_speed, dt, force, inertia, 0.0, 0.0)
    size = scale(x, v, dt, force, inertia, 0.0) + abs(end)
    assert back == pytest.approx(x, abs=1e-13 * size)
    assert back_speed == pytest.approx(-v, abs=1e-13 * size / dt)
