"""From command to motor current: link, converter, limit, delay and current loop."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from hapticd.plant.resolution import substeps_for
from tests.plant.effects.independent import PERIOD, Floats, motor_current, vector

RANDOM = np.random.default_rng(3)
COMMANDS = RANDOM.uniform(-1, 1, 40)


def _held(t: float, delay: float) -> float:
    return float(COMMANDS[min(max(math.floor((t - delay) / PERIOD + 1e-9), 0), len(COMMANDS) - 1)])


@pytest.mark.parametrize("delay", [0.0, 1.3e-4, 5e-4, 1e-3, 2.7e-3])
@pytest.mark.parametrize("substeps", [1, 3])
def test_a_delay_switches_inside_a_substep(delay: float, substeps: int) -> None:
    p = vector(delay_s=0.4 * delay, transport_delay__t_d=0.6 * delay)
    got = motor_current(p, COMMANDS, substeps)
    h = PERIOD / substeps
    for k in range(len(COMMANDS)):
        for j in range(substeps):
            begin = k * PERIOD + j * h
            fine = [_held(begin + (n + 0.5) * h / 1000, delay) for n in range(1000)]
            assert got[k, j] == pytest.approx(np.mean(fine), abs=2.1e-3)
    if delay == 0.0:
        assert np.array_equal(got, np.repeat(COMMANDS[:, None], substeps, axis=1))


@pytest.mark.parametrize(("f_a", "delta"), [(80.0, 0.7), (300.0, 0.2), (300.0, 1.0), (1500.0, 5.0)])
def test_the_current_loop_is_exact(f_a: float, delta: float) -> None:
    delay, substeps = 3e-4, 2
    p = vector(delay_s=delay, amplifier_lag__f_a=f_a, amplifier_lag__delta=delta)
    got = motor_current(p, COMMANDS, substeps)
    natural = 2 * math.pi * f_a
    y: Floats = np.array([COMMANDS[0], 0.0, 0.0])
    slopes = np.array([[0.0, 1.0, 0.0], [-(natural**2), -2 * delta * natural, 0.0], [1.0, 0.0, 0.0]])
    edges = sorted({k * PERIOD / substeps for k in range(20 * substeps + 1)} | {k * PERIOD + delay for k in range(20)})
    charges = {0.0: 0.0}
    for begin, end in pairwise(edges):
        aim = _held(0.5 * (begin + end), delay)
        held = np.block([[slopes, np.array([[0.0], [natural**2 * aim], [0.0]])], [np.zeros((1, 4))]])
        y = (expm((end - begin) * held) @ [*y, 1.0])[:3]
        charges[end] = y[2]
    boundaries = [k * PERIOD / substeps for k in range(20 * substeps + 1)]
    expected = np.diff([charges[b] for b in boundaries]) / (PERIOD / substeps)
    assert np.abs(got[:20].ravel() - expected).max() < 1e-6


def test_grid_and_limit_come_in_this_order() -> None:
    got = motor_current(vector(dac_quantization__q=0.2, current_saturation__i_max=0.5), COMMANDS, 1)[:, 0]
    assert np.array_equal(got, np.clip(0.2 * np.rint(COMMANDS / 0.2), -0.5, 0.5))
    assert 0.5 in got


def test_a_lost_command_leaves_the_last_one() -> None:
    lost = [0, 3, 4, 17]
    got = motor_current(vector(), COMMANDS, 1, lost)[:, 0]
    expected = COMMANDS.copy()
    expected[3] = expected[4] = COMMANDS[2]
    expected[17] = COMMANDS[16]
    assert np.array_equal(got, expected)


def test_substeps_follow_the_fastest_effect() -> None:
    assert substeps_for(vector(), PERIOD) == 1
    assert substeps_for(vector(backlash__gap=0.1, transport_delay__t_d=1e-3, return_spring__k_s=1.0), PERIOD) == 1
    slow = substeps_for(vector(amplifier_lag__f_a=20.0), PERIOD)
    fast = substeps_for(vector(amplifier_lag__f_a=400.0), PERIOD)
    assert 1 <= slow < fast <= 64
    assert substeps_for(vector(amplifier_lag__f_a=400.0), PERIOD / 10) < fast


@pytest.mark.parametrize("f_r", [20.0, 200.0])
def test_a_coupling_that_swings_is_exact_and_one_that_creeps_takes_substeps(f_r: float) -> None:
    coupling = {"flexible_coupling__f_r": f_r, "flexible_coupling__load_share": 0.5}
    assert substeps_for(vector(flexible_coupling__damping=0.1, **coupling), PERIOD) == 1
    bristle = {"presliding__breakaway": 0.01, "presliding__sigma_1": 1e-4}
    for more in ({"flexible_coupling__damping": 0.8}, {"flexible_coupling__damping": 0.1, **bristle}):
        assert substeps_for(vector(**coupling, **more), PERIOD) == (1 if f_r == 20.0 else 6)
