"""Every mechanical law of one mass against solve_ivp, with reversals and stops; exact laws to 1e-8, others to 2e-3."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from hapticd.plant.layout import initial_state
from tests.plant.effects.independent import KT, B, C, J, Laws, apart, excitation, simulated, vector

EXACT = 1e-8

HAND = {"m_h": 4e-6, "b_h": 5e-5, "k_h": 0.02, "on_s": 0.0403, "off_s": 0.1017, "rest": 0.3}


def _gripped(t: float) -> bool:
    return HAND["on_s"] <= t < HAND["off_s"]


CASES: dict[str, tuple[dict[str, Any], Laws, float]] = {
    "base": ({}, Laws(), EXACT),
    "inertia_error": ({"inertia_error__r": 0.7}, Laws(inertia=lambda t: 1.7 * J), EXACT),
    "viscous_friction": ({"viscous_friction__r": 15.0}, Laws(drag=lambda v, t: 16 * B * v), EXACT),
    "coulomb_friction": ({"coulomb_friction__r": 0.6}, Laws(level=lambda s, i, t: 1.6 * C), EXACT),
    "torque_constant_error": ({"torque_constant_error__r": -0.3}, Laws(field=lambda x, i, t: -0.3 * KT * i), EXACT),
    "constant_bias": ({"constant_bias__tau_0": -8e-4}, Laws(field=lambda x, i, t: -8e-4), EXACT),
    "asymmetric_coulomb": ({"asymmetric_coulomb__a": 0.4}, Laws(field=lambda x, i, t: -0.4 * C), EXACT),
    "asymmetric_viscous": (
        {"asymmetric_viscous__a": 0.8, "viscous_friction__r": 15.0},
        Laws(drag=lambda v, t: 16 * B * (1 + 0.8 * math.copysign(1, v)) * v),
        EXACT,
    ),
    "load_dependent_friction": (
        {"load_dependent_friction__kappa": 0.3},
        Laws(level=lambda s, i, t: C + 0.3 * KT * abs(i)),
        EXACT,
    ),
    "return_spring": (
        {"return_spring__k_s": 0.03, "return_spring__theta_0": 0.2},
        Laws(field=lambda x, i, t: -0.03 * (x - 0.2)),
        EXACT,
    ),
    "hand_impedance": (
        {f"hand_impedance__{key}": value for key, value in HAND.items()},
        Laws(
            field=lambda x, i, t: -0.02 * (x - 0.3) if _gripped(t) else 0.0,
            drag=lambda v, t: (B + (5e-5 if _gripped(t) else 0.0)) * v,
            inertia=lambda t: J + (4e-6 if _gripped(t) else 0.0),
            breaks=(HAND["on_s"], HAND["off_s"]),
        ),
        EXACT,
    ),
    "stribeck": (
        {"stribeck__s": 0.8, "stribeck__omega_s": 2.0},
        Laws(level=lambda s, i, t: C * (1 + 0.8 * math.exp(-((s / 2.0) ** 2)))),
        2e-3,
    ),
    "quadratic_drag": ({"quadratic_drag__d": 2e-6}, Laws(drag=lambda v, t: B * v + 2e-6 * v * abs(v)), 2e-4),
    "degressive_drag": ({"quadratic_drag__d": -3e-7}, Laws(drag=lambda v, t: B * v - 3e-7 * v * abs(v)), 2e-4),
    "gravity": (
        {"gravity__m_g_l": 3e-3, "gravity__theta_0": 0.4},
        Laws(field=lambda x, i, t: -3e-3 * math.sin(x - 0.4)),
        2e-3,
    ),
    "torque_ripple": (
        {"torque_ripple__orders": [7, 24], "torque_ripple__amplitudes": [4e-4, 2e-4], "torque_ripple__phases": [1, 2]},
        Laws(field=lambda x, i, t: 4e-4 * math.sin(7 * x + 1) + 2e-4 * math.sin(24 * x + 2)),
        2e-3,
    ),
    "ripple_of_the_current": (
        {
            "torque_ripple__orders": [5],
            "torque_ripple__amplitudes": [4e-3],
            "torque_ripple__current_proportion": 0.75,
        },
        Laws(field=lambda x, i, t: 4e-3 * math.sin(5 * x) * (0.25 + 0.75 * i)),
        2e-3,
    ),
    "thermal_drift": (
        {"thermal_drift__r": 0.7, "thermal_drift__t_w": 0.05},
        Laws(level=lambda s, i, t: C * (1 + 0.7 * (1 - math.exp(-t / 0.05)))),
        2e-4,
    ),
    "several": (
        {
            "stribeck__s": 0.5,
            "stribeck__omega_s": 3.0,
            "gravity__m_g_l": 2e-3,
            "return_spring__k_s": 0.01,
            "asymmetric_viscous__a": 0.5,
            "coulomb_friction__r": -0.2,
        },
        Laws(
            field=lambda x, i, t: -2e-3 * math.sin(x) - 0.01 * x,
            level=lambda s, i, t: 0.8 * C * (1 + 0.5 * math.exp(-((s / 3.0) ** 2))),
            drag=lambda v, t: B * (1 + 0.5 * math.copysign(1, v)) * v,
        ),
        2e-3,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_trajectory_is_that_of_an_independent_integrator(name: str) -> None:
    changes, laws, tolerance = CASES[name]
    currents = excitation(150)
    got, _ = simulated(vector(**changes), currents)
    expected = laws.run(currents)
    assert np.ptp(expected) > 0.1
    assert apart(got, expected) < tolerance


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case[2] > EXACT and name != "thermal_drift"])
def test_the_step_is_second_order(name: str) -> None:
    changes, _, _ = CASES[name]
    # One direction and no stop: their instants are the only thing that is not smooth in the step.
    state, currents = initial_state(0.3, 6.0), np.full(20, 0.08)
    p = vector(**changes)
    finest, _ = simulated(p, currents, state, 256)
    errors = [float(np.abs(simulated(p, currents, state, n)[0] - finest).max()) for n in (2, 4, 8)]
    assert errors[0] > 3.3 * errors[1] > 3.3 * 3.3 * errors[2]
