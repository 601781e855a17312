"""The LuGre bristle against solve_ivp, in its two limits, and its energy."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from hapticd.plant.layout import BRISTLE, OMEGA, THETA, initial_state
from tests.plant.effects.independent import KT, B, C, Floats, J, apart, excitation, simulated, stiff, vector


def lugre(breakaway: float, sigma_1: float, s: float = 0.0, omega_s: float = 1.0):  # type: ignore[no-untyped-def]
    sigma_0 = C / breakaway

    def motion(t: float, y: Floats, current: float) -> tuple[float, float, float]:
        _, v, z = y
        level = C * (1 + s * math.exp(-((v / omega_s) ** 2)))
        rate = v - sigma_0 * abs(v) * z / level
        return v, (KT * current - sigma_0 * z - sigma_1 * rate - B * v) / J, rate

    return motion


@pytest.mark.parametrize(
    ("breakaway", "sigma_1", "s"),
    [(1e-2, 0.0, 0.0), (1e-2, 2e-4, 0.0), (1e-3, 3e-4, 0.0), (1e-4, 1e-3, 0.0), (3e-3, 2e-4, 0.6)],
)
def test_trajectory_is_that_of_an_independent_integrator(breakaway: float, sigma_1: float, s: float) -> None:
    currents = excitation(100)
    p = vector(presliding__breakaway=breakaway, presliding__sigma_1=sigma_1, stribeck__s=s, stribeck__omega_s=3.0)
    got, _ = simulated(p, currents)
    expected = stiff(lugre(breakaway, sigma_1, s, 3.0), currents, (0.0, 0.0, 0.0))
    assert apart(got, expected) < 3e-3


def test_below_breakaway_it_is_a_spring_with_hysteresis() -> None:
    breakaway, current = 5e-3, 0.1 * C / KT
    p = vector(presliding__breakaway=breakaway, viscous=8e-3)
    pushed, state = simulated(p, np.full(400, current))
    # Without overshoot the way there and the way back are those over which z = ±b (1 − exp(∓x/b)) changes by 0.1 b.
    assert pushed[-1] == pytest.approx(-math.log(1 - 0.1) * breakaway, rel=1e-6)
    returned, _ = simulated(p, np.zeros(400), state)
    assert returned[-1] - pushed[-1] == pytest.approx(-math.log(1 + 0.1) * breakaway, rel=1e-6)


@pytest.mark.parametrize("substeps", [1, 3])
def test_a_small_breakaway_displacement_tends_to_coulomb_friction(substeps: int) -> None:
    currents = excitation(150)
    coulomb, _ = simulated(vector(), currents, substeps=substeps)
    distances = []
    for breakaway in (1e-4, 1e-5, 1e-6, 1e-7, 1e-9):
        got, _ = simulated(
            vector(presliding__breakaway=breakaway, presliding__sigma_1=1e-4), currents, substeps=substeps
        )
        distances.append(apart(got, coulomb))
    # The work c·b that a reversal saves is a speed √(2 c b / J): the distance goes with the root of b.
    for coarse, fine in pairwise(distances[:4]):
        assert fine == pytest.approx(coarse / math.sqrt(10), rel=0.1)
    assert distances[-1] < 1e-4


def test_steady_sliding_has_the_coulomb_friction() -> None:
    state = initial_state(0.0, 20.0)
    state[BRISTLE] = 1e-3
    bristle, end = simulated(vector(presliding__breakaway=1e-3), np.zeros(20), state)
    coulomb, _ = simulated(vector(), np.zeros(20), state)
    assert np.abs(bristle - coulomb).max() < 1e-12
    assert end[BRISTLE] == pytest.approx(1e-3, rel=1e-12)


def test_a_free_shaft_never_gains_energy() -> None:
    p = vector(presliding__breakaway=1e-3, presliding__sigma_1=1e-4)
    sigma_0 = C / 1e-3
    state = initial_state(0.0, 3.0)
    energies = [0.5 * J * 3.0**2]
    for _ in range(60):
        _, state = simulated(p, np.zeros(1), state)
        energies.append(0.5 * J * state[OMEGA] ** 2 + 0.5 * sigma_0 * state[BRISTLE] ** 2)
    assert np.all(np.diff(energies) <= 2e-3 * energies[0])
    assert energies[-1] < 0.02 * energies[0]
    assert abs(state[THETA]) < 1.0
