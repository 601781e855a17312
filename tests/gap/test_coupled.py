"""The filter with a load behind a coupling, against a textbook Kalman filter of four states and a disturbance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from hapticd.gap.kernel.filter import run_filter
from hapticd.gap.kernel.samples import Samples
from hapticd.gap.kernel.ticks import TICK
from hapticd.plant.layout import index_of, neutral_vector

Floats = NDArray[np.float64]
PERIOD, RESONANCE, SHARE, DAMPING = 1e-3, 25.0, 0.4, 0.05
NOISE = np.array([0.05, 1e-4, 0.3, 0.02, 0.0])
"""White force, sensor, disturbance, its correlation time, jitter."""


def _system(period: float = PERIOD) -> tuple[Floats, Floats, Floats]:
    """Exact discretisation (Van Loan) of (x, v, d, load's x, load's v), inertia 1 in all; and what a torque adds."""
    white, _, disturbance, tau, _ = NOISE
    natural, motor = 2.0 * np.pi * RESONANCE, 1.0 - SHARE
    spring, damper = SHARE * natural**2, 2.0 * SHARE * DAMPING * natural
    F = np.array(
        [
            [0.0, 1.0, 0.0, 0.0, 0.0],
            [-spring / motor, -damper / motor, 1.0 / motor, spring / motor, damper / motor],
            [0.0, 0.0, -1.0 / tau, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 1.0],
            [spring / SHARE, damper / SHARE, 0.0, -spring / SHARE, -damper / SHARE],
        ]
    )
    L = np.diag([0.0, (white / motor) ** 2, 2.0 * disturbance**2 / tau, 0.0, 0.0])
    big = expm(np.block([[-F, L], [np.zeros((5, 5)), F.T]]) * period)
    A = big[5:, 5:].T
    column = expm(np.block([[F, np.eye(5)[:, 1:2] / motor], [np.zeros((1, 6))]]) * period)[:5, 5]
    return A, A @ big[:5, 5:], column


def _record(n: int, seed: int, uneven: float = 0.0) -> tuple[Floats, Floats, Floats]:
    """Lengths of the periods, current, and what the encoder showed of a shaft whose load swings from the beginning on."""
    rng = np.random.default_rng(seed)
    spans = PERIOD * (1.0 + uneven * rng.uniform(-1.0, 1.0, n))
    current = 3.0 * np.sin(2.0 * np.pi * 3.0 * PERIOD * np.arange(n))
    state, shown = np.array([0.0, 0.5, 0.0, 1e-3, 0.65]), np.empty(n)
    for k in range(n):
        shown[k] = state[0] + NOISE[1] * rng.normal()
        A, Q, B = _system(spans[k])
        root = np.linalg.cholesky(Q + 1e-24 * np.eye(5))
        state = A @ state + B * current[k] + root @ rng.normal(size=5)
    return spans, current, shown


def _filtered(spans: Floats, current: Floats, shown: Floats) -> NDArray[Any]:
    p = neutral_vector()
    p[index_of("inertia")] = p[index_of("torque_constant")] = 1.0
    p[index_of("viscous")] = p[index_of("coulomb")] = 0.0
    p[index_of("flexible_coupling.f_r")] = RESONANCE
    p[index_of("flexible_coupling.load_share")], p[index_of("flexible_coupling.damping")] = SHARE, DAMPING
    n, resolution = current.size, 1e-3 * NOISE[1]
    time_s = np.concatenate([[0.0], np.cumsum(spans)[:-1]])
    lasts = np.append(np.diff(time_s), PERIOD)[:, None].copy()
    out = np.zeros(n, TICK)
    cell = np.floor(shown / resolution)
    first = np.arange(n) == 0
    run_filter(
        p, NOISE, Samples(resolution, time_s, cell, first, lasts, current[:, None].copy(), np.zeros((n, 1))), out
    )
    return out


def _textbook(spans: Floats, current: Floats, shown: Floats, twist: float) -> tuple[Floats, Floats]:
    """Predictions and their variances, begun as the workflow's filter begins: a load that swings by `twist`."""
    n, natural = current.size, 2.0 * np.pi * RESONANCE
    v = (shown[5] - shown[0]) / spans[:5].sum()
    state, P = np.array([shown[0], v, 0.0, shown[0], v]), np.zeros((5, 5))
    P[np.ix_([0, 3], [0, 3])], P[np.ix_([1, 4], [1, 4])] = NOISE[1] ** 2, v**2
    P[2, 2] = NOISE[2] ** 2
    P[3, 3] += twist**2
    P[4, 4] += (natural * twist) ** 2
    predicted, variance = np.empty(n), np.empty(n)
    for k in range(n):
        predicted[k], variance[k] = state[0], P[0, 0] + NOISE[1] ** 2
        gain = P[:, 0] / variance[k]
        state = state + gain * (shown[k] - state[0])
        P = P - np.outer(gain, gain) * variance[k]
        A, Q, B = _system(spans[k])
        state, P = A @ state + B * current[k], A @ P @ A.T + Q
    return predicted, variance


@pytest.mark.parametrize("uneven", [0.0, 0.03, 0.3])
def test_it_is_a_kalman_filter(uneven: float) -> None:
    record = _record(1500, 3, uneven)
    out = _filtered(*record)
    predicted, variance = _textbook(*record, 1e-4)
    settled = slice(500, None)
    assert np.abs(out["mean"] - predicted)[settled].max() < 0.01 * np.sqrt(variance[-1])
    assert out["variance"][settled] == pytest.approx(variance[settled], rel=0.01)


def test_periods_of_about_one_length_are_as_exact_as_those_of_one_length() -> None:
    spans, current, shown = _record(1500, 3, 0.03)
    first = _filtered(spans, current, shown)
    other = spans.copy()
    other[0] *= 1.2  # the usual length is that of the first period: from here each is computed by itself
    second = _filtered(other, current, shown)
    settled = slice(500, None)
    assert np.abs(first["mean"] - second["mean"])[settled].max() < 1e-4 * np.sqrt(first["variance"][-1])


@pytest.mark.parametrize("seed", range(3))
def test_a_load_may_swing_when_the_record_begins(seed: int) -> None:
    spans, current, shown = _record(100, seed)
    out = _filtered(spans, current, shown)
    usual = np.sqrt(np.mean(current**2)) / (2.0 * np.pi * RESONANCE) ** 2

    def surprise(predicted: Floats, variance: Floats) -> float:
        return float(np.sqrt(np.mean((shown - predicted) ** 2 / variance)))

    found = surprise(out["mean"], out["variance"])
    assert found == pytest.approx(surprise(*_textbook(spans, current, shown, usual)), rel=0.05)
    assert found < 0.9 * surprise(*_textbook(spans, current, shown, 0.0))
