"""Motion behind a current loop of second order: against SciPy, a finer division, and the way of the effects."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hapticd.config import apply_settings, load_config
from hapticd.plant import kernel
from hapticd.plant.lagged import SPAN_WORDS, lagged_motion, parts_per_time, prepare
from hapticd.plant.layout import index_of

Floats = NDArray[np.float64]
_PARTS, _WHOLE, _PART = 1, 2, 9


def made(natural: float, ratio: float, mu: float, beta: float, span: float, finer: int = 1) -> Floats:
    """What `prepare` makes; its parts so many times finer."""
    coarse, fine = np.zeros(SPAN_WORDS), np.zeros(SPAN_WORDS)
    finest = parts_per_time(natural, 1.0)
    prepare(natural, ratio, mu, beta, finest, span, coarse)
    if finer > 1:
        parts = int(coarse[_PARTS]) * finer
        prepare(natural, ratio, mu, beta, finest, span / parts, fine)
        coarse[_PARTS], coarse[_PART : _PART + 7] = parts, fine[_WHOLE : _WHOLE + 7]
    return coarse


State = tuple[float, float, float, float, float]


def drawn(rng: np.random.Generator, speed: float) -> tuple[State, tuple[float, ...], float]:
    """A state (x, v, force, rate, aim), a device (μ, β, σ, ω, δ) and a span."""
    x, v, force, rate, aim = rng.normal(0.0, (3.0, speed, 3.0, 3.0, 3.0)).tolist()
    device: tuple[float, ...] = (10.0 ** rng.uniform(0.0, 2.5), rng.uniform(0.0, 2.0), rng.uniform(0.0, 2.0))
    device = (*device, 10.0 ** rng.uniform(-1.5, 1.7), 10.0 ** rng.uniform(-1.0, 0.5))
    return (x, v, force, rate, aim), device, rng.uniform(0.05, 1.0)


def _slope(_: float, y: Floats, flow: Floats, given: Floats) -> Floats:
    return np.asarray(flow @ y + given)


def test_a_slide_is_that_of_scipy() -> None:
    rng = np.random.default_rng(5)
    for _ in range(60):
        (x, v, force, rate, aim), (mu, beta, sigma, natural, ratio), span = drawn(rng, 1.0)
        v = math.copysign(30.0, v)  # it does not stop

        flow = np.array(
            [
                [0.0, 1.0, 0.0, 0.0],
                [0.0, -beta / mu, 1.0 / mu, 0.0],
                [0.0, 0.0, 0.0, 1.0],
                [0.0, 0.0, -natural * natural, -2.0 * ratio * natural],
            ]
        )
        given = np.array([0.0, -math.copysign(sigma, v) / mu, 0.0, natural * natural * aim])
        begin = [x, v, force, rate * natural]
        end = solve_ivp(_slope, (0.0, span), begin, "DOP853", args=(flow, given), rtol=1e-12, atol=1e-12)
        found = lagged_motion(x, v, force, rate, aim, mu, beta, sigma, 0.0, made(natural, ratio, mu, beta, span))
        assert found[:3] == pytest.approx(end.y[:3, -1], rel=1e-8, abs=1e-8)
        assert found[3] * natural == pytest.approx(end.y[3, -1], rel=1e-7, abs=1e-7)


def test_what_dividing_a_period_costs() -> None:
    rng = np.random.default_rng(6)
    errors = []
    for _ in range(4000):
        state, (mu, beta, sigma, natural, ratio), span = drawn(rng, 0.3)
        coarse, fine = (
            lagged_motion(*state, mu, beta, sigma, 0.0, made(natural, ratio, mu, beta, span, finer))
            for finer in (1, 64)
        )
        # in units of what the largest force does to the mass in a period
        pushed = (sum(map(abs, state[2:])) + sigma) / mu
        errors.append([abs(coarse[0] - fine[0]) / pushed, abs(coarse[1] - fine[1]) / pushed])
    worst = np.array(errors)
    assert (worst.max(axis=0) < [0.004, 0.004]).all()


@pytest.mark.parametrize(("bandwidth_hz", "ratio", "hand"), [(40.0, 0.3, 0.0), (500.0, 0.2, 0.0), (3000.0, 0.7, 0.004)])
def test_the_plant_moves_as_with_the_effect_in_fine_steps(bandwidth_hz: float, ratio: float, hand: float) -> None:
    config = apply_settings(load_config(None), {"amplifier.dac_bits": 0, "hand.stiffness": hand})
    lag = {"name": "amplifier_lag", "f_a": bandwidth_hz, "delta": ratio}
    amplifier = {"amplifier.bandwidth_hz": bandwidth_hz, "amplifier.damping_ratio": ratio}
    ours = kernel.init_plant(apply_settings(config, amplifier), 0.1, 3.0, current_loop=True)
    ideal = apply_settings(config, {"amplifier.bandwidth_hz": 0, "plant.effects": [lag]})
    fine = kernel.init_plant(ideal, 0.1, 3.0)
    as_effect = kernel.init_plant(ideal, 0.1, 3.0)
    assert (as_effect[kernel.NATURAL], as_effect[kernel.LAG_NS]) == (ours[kernel.NATURAL], ours[kernel.LAG_NS])
    fine[kernel.NATURAL], fine[kernel.LONGEST_STEP] = 0.0, 2e-6
    fine.view(np.int64)[kernel.HAS_EFFECT_TERMS] = 1
    fine[kernel.DEVICE + index_of("amplifier_lag.f_a")] = bandwidth_hz
    rng = np.random.default_rng(3)
    for tick, current in enumerate(rng.normal(0.0, 0.2, 200)):
        for f in (ours, fine):
            kernel.plant_current(f, f.view(np.int64), tick * 1_000_000, 0.0, current)
            kernel.plant_advance(f, f.view(np.int64), (tick + 1) * 1_000_000, 0.0)
        assert ours[kernel.CURRENT] == pytest.approx(fine[kernel.CURRENT], abs=1e-9)
        assert ours[kernel.POSITION] == pytest.approx(fine[kernel.POSITION], abs=1e-4)
        assert ours[kernel.VELOCITY] == pytest.approx(fine[kernel.VELOCITY], abs=2e-2)


def test_a_shaft_stays_only_if_the_swing_of_the_current_is_held_too() -> None:
    f = kernel.init_plant(load_config(None), current_loop=True)
    i = f.view(np.int64)
    holds = f[kernel.COULOMB] / f[kernel.TORQUE_CONSTANT]
    f[kernel.AIM] = f[kernel.CURRENT] = 0.9 * holds
    assert kernel.plant_stays(f, i)
    f[kernel.CURRENT_RATE] = 0.2 * holds
    assert not kernel.plant_stays(f, i)
