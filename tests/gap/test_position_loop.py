"""An axis under a position loop, as most machines are recorded: the controller answers the very torque that nobody knows."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from hapticd.config import Config, parse_config
from hapticd.gap import find_gap
from hapticd.gap.base_model import balanced, known_terms, problem_of
from hapticd.gap.choose import Search
from hapticd.gap.recording import Recording
from hapticd.gap.terms import BASE_WORDS

Floats = NDArray[np.float64]

INERTIA, VISCOUS, COULOMB, TORQUE_CONSTANT = 2e-4, 1e-3, 0.02, 0.05
PERIOD_S, SUBSTEPS = 1e-3, 200
BANDWIDTH_HZ, DAMPING_RATIO = 15.0, 0.8
NOISE_RAD = 1e-4


@numba.njit
def _axis(
    reference: Floats, noise: Floats, torque: Floats, inertia: float, viscous: float, coulomb: float, gains: Floats
) -> tuple[Floats, Floats]:
    """Measured position and current of an axis that follows a reference; semi-implicit steps of 5 µs, with stiction."""
    n, dt = reference.size, PERIOD_S / SUBSTEPS
    position, current = np.empty(n), np.empty(n)
    x, v, rate = reference[0], 0.0, 0.0
    last = x
    for k in range(n):
        y = x + noise[k]
        ahead = (reference[min(k + 1, n - 1)] - reference[k]) / PERIOD_S
        rate += 0.2 * ((y - last) / PERIOD_S - rate)
        last = y
        i = gains[0] * (reference[k] - y) + gains[1] * (ahead - rate)
        position[k], current[k] = y, i
        for _ in range(SUBSTEPS):
            push = TORQUE_CONSTANT * i + torque[k]
            before = v
            if v == 0.0:
                if abs(push) <= coulomb:
                    continue
                v = dt * (push - math.copysign(coulomb, push)) / inertia
            else:
                after = v + dt * (push - viscous * v - math.copysign(coulomb, v)) / inertia
                v = after if after * v > 0.0 else 0.0
            x += 0.5 * dt * (before + v)
    return position, current


def recorded(
    seed: int, duration_s: float = 12.0, *, line_hz: float = 0.0, **factors: float
) -> tuple[Recording, Config]:
    """A recording beside a coloured torque of 5 % of Coulomb friction, and the nominal model.

    Args:
        seed: of reference, noise and torque. duration_s: length.
        line_hz: of a swinging torque of 5 % of Coulomb friction besides; 0 for none.
        factors: on ``inertia``, ``viscous`` and ``coulomb`` of the true device.
    """
    rng = np.random.default_rng(seed)
    n = int(duration_s / PERIOD_S)
    time_s = PERIOD_S * np.arange(n)
    omega, size, phase = 2.0 * np.pi * np.array([0.13, 0.31, 0.73, 1.7]), np.array([2.0, 1.0, 0.4, 0.12]), rng.random(4)
    reference = size @ np.sin(np.outer(omega, time_s) + 2.0 * np.pi * phase[:, None])
    kept = math.exp(-PERIOD_S / 0.05)
    torque = np.zeros(n)
    for k in range(1, n):
        torque[k] = kept * torque[k - 1] + math.sqrt(1.0 - kept**2) * rng.normal()
    natural = 2.0 * np.pi * BANDWIDTH_HZ
    gains = INERTIA / TORQUE_CONSTANT * np.array([natural**2, 2.0 * DAMPING_RATIO * natural])
    position, current = _axis(
        reference,
        rng.normal(0.0, NOISE_RAD, n),
        0.05 * COULOMB * (torque + np.sin(2.0 * np.pi * line_hz * time_s)),
        INERTIA * factors.get("inertia", 1.0),
        VISCOUS * factors.get("viscous", 1.0),
        COULOMB * factors.get("coulomb", 1.0),
        gains,
    )
    return Recording("axis", time_s, position, 0.0, current, None, PERIOD_S, False), nominal()


def nominal(**factors: float) -> Config:
    """The nominal model, with factors on what is known of ``inertia``, ``viscous`` and ``coulomb``."""
    off: dict[str, Any] = {"bandwidth_hz": 0, "dac_bits": 0, "peak_current": 0, "continuous_current": 0}
    known = {"inertia": INERTIA, "viscous": VISCOUS, "coulomb": COULOMB}
    return parse_config(
        {
            "plant": {name: factors.get(name, 1.0) * value for name, value in known.items()},
            "amplifier": {"torque_constant": TORQUE_CONSTANT, **off},
        },
        "the axis",
    )


@pytest.mark.parametrize("seed", [1, 2])
def test_what_the_controller_answers_is_no_effect(seed: int) -> None:
    recording, model = recorded(seed)
    result = find_gap([recording], model)
    assert result.verdict == "no_missing_effect", result.statement
    assert result.remainder.structure == ()


def test_a_wrong_friction_is_named_and_nothing_is_left() -> None:
    recording, model = recorded(3, coulomb=1.3)
    result = find_gap([recording], model)
    assert (result.verdict, result.effects) == ("effect_found", ("coulomb_friction",)), result.statement
    found = result.steps[0].parameters["r"]
    assert found.ci95[0] < 0.3 < found.ci95[1]


def test_a_line_in_time_is_no_effect_though_the_controller_answers_it() -> None:
    """Its phase is known from the motion before: it had looked like a torque that depends on the acceleration."""
    recording, model = recorded(3, line_hz=31.0)
    result = find_gap([recording], model, design=False)
    assert result.verdict == "no_missing_effect", result.statement
    assert "a line at 31 Hz in time" in result.remainder.words


@pytest.mark.parametrize(
    ("inertia", "viscous", "coulomb"), [(0.15, 1.0, 5.0), (0.15, 10.0, 0.1), (1.0, 0.1, 10.0), (5.0, 0.1, 0.1)]
)
def test_a_base_that_is_only_guessed_is_found(inertia: float, viscous: float, coulomb: float) -> None:
    """From the guess alone three of these climbs end elsewhere; from the balance of forces none does."""
    recording, _ = recorded(4)
    guess = nominal(inertia=inertia, viscous=viscous, coulomb=coulomb)
    problem = problem_of([recording], guess)
    search = Search(problem, list(BASE_WORDS), known_terms(problem, guess), balanced([recording], guess))
    first = next(search.rounds()).chosen
    assert first.laws == tuple(BASE_WORDS)
    found = np.exp(first.fit.u[-3:])
    assert found == pytest.approx([INERTIA, VISCOUS, COULOMB], rel=0.1)
