"""A shaft without dry friction under white and coloured force, and the textbook's answers for it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from hapticd.gap.kernel.filter import run_filter
from hapticd.gap.kernel.samples import Samples
from hapticd.gap.kernel.ticks import TICK
from hapticd.plant.layout import index_of, neutral_vector

Floats = NDArray[np.float64]
INERTIA, TORQUE_CONSTANT, PERIOD = 1.0, 1.0, 1e-3


class Case(NamedTuple):
    """A record and its noise: white σ, sensor r, disturbance s, its τ, jitter."""

    time_s: Floats
    current: Floats
    measured: Floats
    states: Floats
    noise: Floats
    resolution: float


def system(noise: Floats, period: float = PERIOD) -> tuple[Floats, Floats, Floats]:
    """Exact discretisation (Van Loan): transition and noise covariance of (x, v, d), and what a torque adds."""
    white, _, disturbance, tau, _ = noise
    F = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0 / INERTIA], [0.0, 0.0, -1.0 / tau]])
    L = np.diag([0.0, (white / INERTIA) ** 2, 2.0 * disturbance**2 / tau])
    big = expm(np.block([[-F, L], [np.zeros((3, 3)), F.T]]) * period)
    A = big[3:, 3:].T
    return A, A @ big[:3, 3:], np.array([0.5 * period**2, period, 0.0]) / INERTIA


def case(
    noise: Floats, n: int = 600, seed: int = 1, cell_share: float = 1e-3, periods: tuple[float, ...] = (PERIOD,)
) -> Case:
    """Draw a record; cells are that share of the sensor's noise wide, and the periods take turns."""
    rng = np.random.default_rng(seed)
    systems = [system(noise, period) for period in periods]
    roots = [np.linalg.cholesky(Q + 1e-30 * np.eye(3)) for _, Q, _ in systems]
    time_s = np.concatenate([[0.0], np.cumsum(np.resize(periods, n - 1))])
    current = np.sin(2.0 * np.pi * 3.0 * PERIOD * np.arange(n))
    states = np.zeros((n, 3))
    states[0] = 0.0, 0.5, rng.normal() * noise[2]
    for k in range(n - 1):
        A, _, B = systems[k % len(periods)]
        states[k + 1] = A @ states[k] + B * current[k] + roots[k % len(periods)] @ rng.normal(size=3)
    resolution = cell_share * noise[1]
    measured = np.floor((states[:, 0] + rng.normal(size=n) * noise[1]) / resolution) * resolution
    return Case(time_s, current, measured, states, noise, resolution)


def device() -> Floats:
    """Device vector of the shaft."""
    p = neutral_vector()
    p[index_of("inertia")], p[index_of("torque_constant")] = INERTIA, TORQUE_CONSTANT
    p[index_of("viscous")] = p[index_of("coulomb")] = 0.0
    return p


def filtered(one: Case, begins: NDArray[np.bool_] | None = None, p: Floats | None = None) -> tuple[float, NDArray[Any]]:
    """The workflow's filter on the case, with the shaft as the device or another one."""
    n = one.time_s.size
    if begins is None:
        begins = np.arange(n) == 0
    out = np.zeros(n, TICK)
    spans = np.diff(one.time_s, append=one.time_s[-1] + PERIOD)[:, None].copy()
    cell = one.measured / one.resolution
    samples = Samples(one.resolution, one.time_s, cell, begins, spans, one.current[:, None].copy(), np.zeros((n, 1)))
    total = run_filter(device() if p is None else p, one.noise, samples, out)
    return total, out


class Textbook(NamedTuple):
    """Kalman filter and Rauch–Tung–Striebel smoother: (n,) predictions and variances, (n, 3) and (n, 3, 3) smoothed."""

    mean: Floats
    variance: Floats
    smoothed: Floats
    covariance: Floats


def textbook(one: Case) -> Textbook:
    """Filter and smooth the case from the first state that the workflow's filter takes."""
    n = one.time_s.size
    spans = np.diff(one.time_s, append=one.time_s[-1] + PERIOD)
    systems = [system(one.noise, span) for span in spans]
    y = one.measured + 0.5 * one.resolution
    span = one.time_s[5]
    v = (one.measured[5] - one.measured[0]) / span
    x = np.array([y[0], v, 0.0])
    P = np.diag([one.resolution**2 + one.noise[1] ** 2, (2.0 * one.resolution / span) ** 2 + v**2, one.noise[2] ** 2])
    mean, variance = np.empty(n), np.empty(n)
    after, spreads, ahead, wider = [], [], [], []
    for k in range(n):
        ahead.append(x)
        wider.append(P)
        mean[k], variance[k] = x[0], P[0, 0] + one.noise[1] ** 2
        gain = P[:, 0] / variance[k]
        x = x + gain * (y[k] - x[0])
        P = P - np.outer(gain, gain) * variance[k]
        after.append(x)
        spreads.append(P)
        A, Q, B = systems[k]
        x = A @ x + B * one.current[k]
        P = A @ P @ A.T + Q
    smoothed, covariance = np.array(after), np.array(spreads)
    for k in range(n - 2, -1, -1):
        G = np.linalg.solve(wider[k + 1], systems[k][0] @ spreads[k]).T
        smoothed[k] = after[k] + G @ (smoothed[k + 1] - ahead[k + 1])
        covariance[k] = spreads[k] + G @ (covariance[k + 1] - wider[k + 1]) @ G.T
    return Textbook(mean, variance, smoothed, covariance)
