"""Backlash and flexible coupling: against solve_ivp, momentum, energy, and the frequencies that name them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from hapticd.effects.backlash import rebound
from hapticd.plant.coupled import Coupling, swing_apart
from hapticd.plant.layout import BRISTLE, CONTACT, LOAD_OMEGA, LOAD_THETA, OMEGA, THETA, initial_state
from tests.plant.effects.independent import KT, PERIOD, B, C, Floats, J, apart, excitation, simulated, stiff, vector


def _smooth_sign(v: float) -> float:
    return math.tanh(v / 1e-3)


@pytest.mark.parametrize(("f_r", "share", "damping"), [(40.0, 0.5, 0.02), (120.0, 0.3, 0.1), (60.0, 0.8, 0.0)])
def test_flexible_coupling_is_that_of_an_independent_integrator(f_r: float, share: float, damping: float) -> None:
    natural, load = 2 * math.pi * f_r, share * J
    k, d = load * natural**2, 2 * damping * load * natural

    def motion(t: float, y: Floats, current: float) -> tuple[float, float, float, float]:
        x, v, load_x, load_v = y
        torque = k * (load_x - x) + d * (load_v - v)
        friction = C * _smooth_sign(v) + B * v
        return v, (KT * current + torque - friction) / (J - load), load_v, -torque / load

    currents = excitation(80)
    p = vector(flexible_coupling__f_r=f_r, flexible_coupling__load_share=share, flexible_coupling__damping=damping)
    got, _ = simulated(p, currents)
    assert apart(got, stiff(motion, currents, (0.0, 0.0, 0.0, 0.0), 1e-8)) < 2e-3
    finer, _ = simulated(p, currents, substeps=64)
    assert apart(got, finer) < 1e-9


@pytest.mark.parametrize("current", [0.06, -0.5, 2.0])
def test_a_coupled_motor_that_stops_and_breaks_away_is_exact_whatever_the_step(current: float) -> None:
    p = vector(flexible_coupling__f_r=35.0, flexible_coupling__load_share=0.6, flexible_coupling__damping=0.03)
    start = initial_state(0.0, 3.0)
    start[LOAD_OMEGA] = -8.0
    currents = np.full(200, current)
    coarse, end = simulated(p, currents, start)
    fine, fine_end = simulated(p, currents, start, substeps=32)
    assert apart(coarse, fine) < 1e-7
    assert end == pytest.approx(fine_end, rel=1e-6, abs=1e-6)
    # Stiction held the motor at least once, or the case tests nothing.
    assert abs(current) > 0.3 or np.any(np.diff(coarse) == 0.0)


@pytest.mark.parametrize("f_r", [15.0, 400.0])
def test_two_motors_that_keep_moving_part_as_the_linear_motion_says(f_r: float) -> None:
    share, damping, way, speed, more = 0.4, 0.05, 1e-4, 0.2, 0.3
    load_way, load_speed = -2e-4, 0.5
    p = vector(flexible_coupling__f_r=f_r, flexible_coupling__load_share=share, flexible_coupling__damping=damping)
    natural, motor = 2.0 * math.pi * f_r, (1.0 - share) * J
    to = Coupling(share * J, share / (1.0 - share), damping * natural, natural * natural)
    start = initial_state(0.0, 50.0)
    start[LOAD_THETA], start[LOAD_OMEGA] = 1e-3, 49.0
    other = start.copy()
    other[THETA] += way
    other[OMEGA] += speed
    other[LOAD_THETA] += load_way
    other[LOAD_OMEGA] += load_speed
    _, end = simulated(p, np.array([1.0]), start)
    _, other_end = simulated(p, np.array([1.0 + more]), other)
    expected = swing_apart(PERIOD, way, speed, load_way, load_speed, KT * more / motor, B / motor, 0.0, to)
    rows = [THETA, OMEGA, LOAD_THETA, LOAD_OMEGA]
    assert (other_end - end)[rows] == pytest.approx(expected, rel=1e-9, abs=1e-13)


@pytest.mark.parametrize("damping", [0.02, 0.8, 3.0])
@pytest.mark.parametrize("f_r", [5.0, 900.0])
def test_two_linear_motions_part_as_their_matrix_says(f_r: float, damping: float) -> None:
    """The matrix exponential of (x, v, load x, load v, acceleration), with friction and a spring about the motor."""
    ratio, rate, omega2, natural = 0.7, 3.0, 400.0, 2.0 * math.pi * f_r
    q = np.array([-(natural**2), -2.0 * damping * natural, natural**2, 2.0 * damping * natural, 0.0])
    F = np.zeros((5, 5))
    F[0, 1] = F[2, 3] = 1.0
    F[1] = ratio * q + np.array([-omega2, -rate, 0.0, 0.0, 1.0])
    F[3] = -q
    start = np.array([1e-3, 0.2, -2e-3, 0.4, 30.0])
    way, speed, load_way, load_speed, a = start
    to = Coupling(0.7, ratio, damping * natural, natural * natural)
    found = swing_apart(PERIOD, way, speed, load_way, load_speed, a, rate, omega2, to)
    assert found == pytest.approx((expm(F * PERIOD) @ start)[:4], rel=1e-9, abs=1e-12)


def test_coupling_keeps_momentum_and_loses_no_more_energy_than_its_damper_takes() -> None:
    f_r, share = 50.0, 0.4
    p = vector(
        coulomb=0.0,
        viscous=0.0,
        flexible_coupling__f_r=f_r,
        flexible_coupling__load_share=share,
        flexible_coupling__damping=0.0,
    )
    state = initial_state(0.0, 0.0)
    state[LOAD_OMEGA] = 4.0
    load, k = share * J, share * J * (2 * math.pi * f_r) ** 2
    energies, momenta, motor = [], [], []
    for _ in range(400):
        _, state = simulated(p, np.zeros(1), state)
        twist = state[LOAD_THETA] - state[THETA]
        momenta.append((J - load) * state[OMEGA] + load * state[LOAD_OMEGA])
        energies.append(0.5 * (J - load) * state[OMEGA] ** 2 + 0.5 * load * state[LOAD_OMEGA] ** 2 + 0.5 * k * twist**2)
        motor.append(state[OMEGA])
    assert np.abs(np.array(momenta) / (load * 4.0) - 1).max() < 1e-11
    assert np.ptp(energies) / energies[0] < 1e-10
    spectrum = np.abs(np.fft.rfft(motor - np.mean(motor), 1 << 16))
    found = np.argmax(spectrum) / ((1 << 16) * PERIOD)
    assert found == pytest.approx(f_r / math.sqrt(1 - share), rel=0.01)


def test_the_motor_stands_still_at_the_anti_resonance() -> None:
    def gain(frequency: float) -> float:
        p = vector(coulomb=0.0, viscous=2e-5, flexible_coupling__f_r=50.0, flexible_coupling__damping=0.005)
        t = np.arange(6000) * PERIOD
        positions, _ = simulated(p, 0.1 * np.sin(2 * np.pi * frequency * t), substeps=8)
        late = positions[4000:] - positions[4000:].mean()
        wave = np.exp(-2j * np.pi * frequency * t[4000:])
        return float(abs(np.mean(late * wave)))

    assert gain(50.0) < 0.1 * min(gain(40.0), gain(60.0))


def _pushed(currents: Floats, gap: float, share: float, k: float, d: float) -> Floats:
    """States (x, v, load x, load v) after every tick, of two masses with a contact that pushes and never pulls, by LSODA."""
    load = share * J

    def motion(t: float, y: Floats, current: float) -> tuple[float, float, float, float]:
        x, v, load_x, load_v = y
        apart = x - load_x
        torque = 0.0
        if apart > gap / 2:
            torque = max(k * (apart - gap / 2) + d * (v - load_v), 0.0)
        elif apart < -gap / 2:
            torque = min(k * (apart + gap / 2) + d * (v - load_v), 0.0)
        return v, (KT * current - torque - C * _smooth_sign(v) - B * v) / (J - load), load_v, torque / load

    found = np.empty((len(currents), 4))
    y = np.zeros(4)
    for n, current in enumerate(currents):
        solved = solve_ivp(
            lambda t, y, current=current: motion(t, y, current),
            (0, PERIOD),
            y,
            method="LSODA",
            rtol=1e-7,
            atol=1e-10,
            max_step=2e-5,
        )
        found[n] = y = solved.y[:, -1]
    return found


def test_backlash_is_the_limit_of_a_stiff_damped_contact() -> None:
    gap, share = 0.02, 0.4
    load = share * J
    reduced = load * (J - load) / J
    natural = 2 * math.pi * 3000.0
    currents = 0.25 * np.sin(2 * np.pi * 35 * np.arange(60) * PERIOD)
    expected = _pushed(currents, gap, share, reduced * natural**2, 2.0 * reduced * natural)
    got, end = simulated(vector(backlash__gap=gap, backlash__load_share=share), currents)
    assert apart(got, expected[:, 0]) < 0.01
    assert end[LOAD_THETA] == pytest.approx(expected[-1, 2], abs=0.01 * np.ptp(expected[:, 0]))
    rigid, _ = simulated(vector(), currents)
    assert apart(rigid, expected[:, 0]) > 0.05


@pytest.mark.parametrize(("stiffness", "damping"), [(2.0, 2e-4), (2.0, 0.0), (0.2, 2e-3), (130.0, 8e-3), (600.0, 0.06)])
def test_a_springy_contact_is_that_of_an_independent_integrator(stiffness: float, damping: float) -> None:
    """Slow and soft, without a damper, one that is all damper, and two that last for less than a tick."""
    gap, share = 0.02, 0.4
    currents = 0.25 * np.sin(2 * np.pi * 35 * np.arange(60) * PERIOD)
    expected = _pushed(currents, gap, share, stiffness, damping)
    p = vector(backlash__gap=gap, backlash__load_share=share, backlash__stiffness=stiffness, backlash__damping=damping)
    got, end = simulated(p, currents)
    assert apart(got, expected[:, 0]) < 2e-3
    assert end[LOAD_THETA] == pytest.approx(expected[-1, 2], abs=2e-3 * np.ptp(expected[:, 0]))
    finer, _ = simulated(p, currents, substeps=16)
    assert apart(got, finer) < 1e-9
    rigid, _ = simulated(vector(backlash__gap=gap, backlash__load_share=share), currents)
    assert apart(rigid, expected[:, 0]) > apart(got, expected[:, 0])


def test_a_springy_contact_on_a_bristle_needs_no_substeps() -> None:
    p = vector(
        backlash__gap=0.02,
        backlash__stiffness=2.0,
        backlash__damping=2e-4,
        presliding__breakaway=2e-3,
        presliding__sigma_1=1e-4,
    )
    currents = 0.25 * np.sin(2 * np.pi * 35 * np.arange(60) * PERIOD)
    got, _ = simulated(p, currents)
    finer, _ = simulated(p, currents, substeps=32)
    assert apart(got, finer) < 3e-3  # the bristle's own, which the first steps have before any contact


@pytest.mark.parametrize("damping", [1.0, 10.0])
def test_a_damper_far_too_strong_for_its_spring_stops_no_clock(damping: float) -> None:
    p = vector(coulomb=0.0, viscous=0.0, backlash__gap=0.02, backlash__stiffness=2.0, backlash__damping=damping)
    state = initial_state(0.0, 0.0)
    state[OMEGA] = 4.0
    positions, end = simulated(p, np.zeros(60), state)
    assert end[[OMEGA, LOAD_OMEGA]] == pytest.approx([2.0, 2.0], rel=1e-2)
    # The first 0.01 rad at full speed, the rest at half of it: together, since the spring has no time to part them.
    assert positions[-1] == pytest.approx(0.01 + 2.0 * (60 * PERIOD - 2.5e-3), rel=1e-2)


@pytest.mark.parametrize("damping", [0.0, 2e-4, 1e-2])
def test_a_springy_contact_keeps_momentum_gains_no_energy_and_never_pulls(damping: float) -> None:
    share, k, half_gap = 0.3, 2.0, 0.01
    p = vector(
        coulomb=0.0,
        viscous=0.0,
        backlash__gap=2.0 * half_gap,
        backlash__load_share=share,
        backlash__stiffness=k,
        backlash__damping=damping,
    )
    state = initial_state(0.0, 0.0)
    state[OMEGA] = 4.0
    energies, momenta, pulls = [], [], []
    for _ in range(200):
        before = state.copy()
        _, state = simulated(p, np.zeros(1), state)
        pressed = max(abs(state[THETA] - state[LOAD_THETA]) - half_gap, 0.0)
        energies.append(
            0.5 * J * ((1 - share) * state[OMEGA] ** 2 + share * state[LOAD_OMEGA] ** 2) + 0.5 * k * pressed**2
        )
        momenta.append((1 - share) * state[OMEGA] + share * state[LOAD_OMEGA])
        both = before[CONTACT] if before[CONTACT] == state[CONTACT] else 0.0
        pulls.append(min(both * (state[LOAD_OMEGA] - before[LOAD_OMEGA]), 0.0))
    assert np.abs(np.array(momenta) / ((1 - share) * 4.0) - 1.0).max() < 1e-9
    assert np.diff(energies).max() < 1e-9 * energies[0]
    assert energies[-1] == pytest.approx(energies[0], rel=1e-8) if damping == 0.0 else energies[-1] < 0.99 * energies[0]
    assert min(pulls) == 0.0


@pytest.mark.parametrize("zeta", [0.0, 0.1, 0.5, 0.71, 1.0, 2.0])
def test_masses_leave_a_springy_contact_as_the_rigid_one_that_stands_for_it(zeta: float) -> None:
    """The closed form of the rebound, against the motion through the contact; stiff enough, they are the same."""
    share, half_gap, speed = 0.4, 0.01, 3.0
    reduced = share * (1 - share) * J

    def parted(hz: float) -> float:
        natural = 2 * math.pi * hz
        p = vector(
            coulomb=0.0,
            viscous=0.0,
            backlash__gap=2.0 * half_gap,
            backlash__load_share=share,
            backlash__stiffness=reduced * natural**2,
            backlash__damping=2 * zeta * reduced * natural,
        )
        state = initial_state(0.0, 0.0)
        state[OMEGA] = speed
        _, end = simulated(p, np.zeros(6), state)
        return float(end[LOAD_OMEGA] - end[OMEGA]) / speed

    expected = rebound(1.0, 2.0 * zeta, 1.0)
    assert parted(1000.0) == pytest.approx(expected, abs=1e-6)
    assert parted(20_000.0) == pytest.approx(min(expected, 0.95), abs=1e-6)


def test_an_impact_keeps_momentum_and_play_keeps_its_width() -> None:
    p = vector(coulomb=0.0, viscous=0.0, backlash__gap=0.02, backlash__load_share=0.3)
    state = initial_state(0.0, 0.0)
    state[OMEGA] = 2.0
    _, state = simulated(p, np.zeros(4), state)
    assert state[CONTACT] == 0.0
    assert state[THETA] == pytest.approx(0.008, rel=1e-12)
    _, state = simulated(p, np.zeros(2), state)
    assert state[OMEGA] == pytest.approx(0.7 * 2.0, rel=1e-12)
    assert state[LOAD_OMEGA] == state[OMEGA]
    # Contact after half the play, at 0.01 rad and 5 ms; then 1 ms together.
    assert state[THETA] == pytest.approx(0.01 + 1.4e-3, rel=1e-12)
    assert state[THETA] - state[LOAD_THETA] == pytest.approx(0.01, rel=1e-12)


def test_backlash_never_gains_energy() -> None:
    p = vector(backlash__gap=0.02, backlash__load_share=0.5)
    state = initial_state(0.0, 0.0)
    state[OMEGA], state[LOAD_OMEGA] = 15.0, -10.0
    energies = []
    for _ in range(80):
        _, state = simulated(p, np.zeros(1), state)
        energies.append(0.25 * J * (state[OMEGA] ** 2 + state[LOAD_OMEGA] ** 2))
        assert abs(state[THETA] - state[LOAD_THETA]) <= 0.01 * (1 + 1e-9)
    assert np.all(np.diff(energies) <= 1e-12 * energies[0])
    assert energies[-1] == 0.0


def test_load_dragged_behind_the_play_is_a_lighter_motor_between_contacts() -> None:
    p = vector(coulomb=0.0, viscous=0.0, backlash__gap=0.2, backlash__load_share=0.25)
    _, state = simulated(p, np.full(1, 0.1))
    assert state[OMEGA] == pytest.approx(0.1 * KT * PERIOD / (0.75 * J), rel=1e-12)
    assert state[LOAD_OMEGA] == 0.0


def test_masses_rebound_at_the_restitution() -> None:
    share, restitution = 0.3, 0.6
    p = vector(
        coulomb=0.0,
        viscous=0.0,
        backlash__gap=0.01,
        backlash__load_share=share,
        backlash__restitution=restitution,
    )
    state = initial_state(0.0, 0.0)
    state[OMEGA] = 3.0
    momentum = (1.0 - share) * state[OMEGA]
    closing, partings = [-3.0], 0
    for _ in range(200):
        _, state = simulated(p, np.zeros(1), state)
        assert (1.0 - share) * state[OMEGA] + share * state[LOAD_OMEGA] == pytest.approx(momentum, rel=1e-9)
        assert abs(state[THETA] - state[LOAD_THETA]) <= 0.005 * (1.0 + 1e-6)
        speed = state[LOAD_OMEGA] - state[OMEGA]
        if speed != pytest.approx(closing[-1], rel=1e-9):
            closing.append(speed)
            partings += 1
    # Each contact turns the relative speed round and leaves a share of it.
    assert partings >= 5
    ratios = np.array(closing[1:6]) / np.array(closing[:5])
    assert ratios == pytest.approx(-restitution, rel=1e-6)


@pytest.mark.parametrize("restitution", [0.3, 0.8, 0.95])
@pytest.mark.parametrize("stribeck", [0.0, 0.5])
def test_rebounds_end_where_they_part_the_masses_no_more(stribeck: float, restitution: float) -> None:
    gap = 0.01
    p = vector(
        backlash__gap=gap,
        backlash__load_share=0.5,
        backlash__restitution=restitution,
        stribeck__s=stribeck,
        stribeck__omega_s=1.0,
    )
    currents = np.full(120, 0.4)
    got, end = simulated(p, currents)
    finer, finer_end = simulated(p, currents, substeps=64)  # fewer rebounds share a step, so fewer are left out
    assert np.abs(got - finer).max() < 5e-3 * gap
    assert end[CONTACT] == finer_end[CONTACT] == 1.0
    assert end[OMEGA] == end[LOAD_OMEGA]
    assert end[OMEGA] == pytest.approx(finer_end[OMEGA], rel=1e-5)


def test_play_on_a_bristle_does_not_stop_the_clock() -> None:
    """A contact that the end of a phase denies and its beginning demands once used up all phases of a tick."""
    gap = 0.03834951969714103
    p = vector(
        backlash__gap=gap,
        backlash__load_share=0.4,
        presliding__breakaway=0.011504855909142308,
        presliding__sigma_1=0.0006269104052779205,
    )
    state = initial_state(0.22063262240109585, 0.018988755801039602)
    state[BRISTLE], state[CONTACT] = -0.00775880701713488, 1.0
    state[LOAD_THETA], state[LOAD_OMEGA] = state[THETA] - 0.5 * gap, state[OMEGA]
    _, after = simulated(p, np.full(1, -0.04541015625), state)
    assert after[THETA] - state[THETA] == pytest.approx(PERIOD * state[OMEGA], rel=0.1)
