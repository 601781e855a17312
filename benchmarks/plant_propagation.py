"""One sampling period of the plant: the closed form against scipy's solve_ivp with events, and against 60 digits.

The periods are those of Fig. 6: μ = 100, a grid over (β, σ), released at 50 ticks a period on the quantised spring, followed
for 40 periods, more than the way out and back. Both methods solve the same periods, in alternating blocks; the compiled
loop feeds every result into the next period, so that none can overlap the one before.
"""

from __future__ import annotations

import math
import statistics
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.report import Figure, progress
from hapticd.jit import njit
from hapticd.plant.exact import propagate
from tests.plant.reference import exact_reference, relative_error

RATIO_GOAL = 5000.0
ERROR_GOAL = 1e-12
MU = 100.0
SPEED = 50.0
PERIODS = 40
TOLERANCES = {"scipy's default tolerance": 1e-3, "the same, rtol 1e-11": 1e-11}
_REPEATS = 200
_TINY_BETAS = (0.0, 1e-15, 1e-12, 1e-9, 1e-6)


@njit("void(float64[:,::1], float64[:,:,::1])")
def _follow(points: NDArray[Any], states: NDArray[Any]) -> None:
    """Propagate every (β, σ) point through its periods; ``states[p, h]`` is (ξ, ξ̇) at the start of period h."""
    for p in range(len(points)):
        xi, xi_dot = 0.0, SPEED
        for h in range(states.shape[1]):
            states[p, h, 0], states[p, h, 1] = xi, xi_dot
            xi, xi_dot = propagate(xi, xi_dot, 1.0, -(math.floor(xi) + 0.5), MU, points[p, 0], points[p, 1])


def _grid(betas: NDArray[np.float64], sigmas: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([(beta, sigma) for beta in betas for sigma in sigmas])


def _states(points: NDArray[np.float64]) -> NDArray[np.float64]:
    states = np.empty((len(points), PERIODS, 2))
    _follow(points, states)
    return states


def _motion(t: float, y: NDArray[np.float64], net: float, beta: float) -> tuple[float, float]:
    return y[1], (net - beta * y[1]) / MU


def _at_rest(t: float, y: NDArray[np.float64], *_: float) -> float:
    return float(y[1])


# solve_ivp reads an event's options from attributes of the function; a type checker knows no such attributes.
_at_rest.terminal = True  # type: ignore[attr-defined]


def _solve_period(xi: float, xi_dot: float, beta: float, sigma: float, rtol: float) -> tuple[float, float]:
    """One period by solve_ivp, with the velocity's zero as an event and stiction there."""
    force, now = -(math.floor(xi) + 0.5), 0.0
    while True:
        if xi_dot == 0.0 and abs(force) <= sigma:
            return xi, 0.0
        sign = math.copysign(1.0, xi_dot if xi_dot != 0.0 else force)
        _at_rest.direction = -sign  # type: ignore[attr-defined]
        net = force - sign * sigma
        result = solve_ivp(
            _motion, (now, 1.0), (xi, xi_dot), args=(net, beta), rtol=rtol, atol=rtol * 1e-3, events=_at_rest
        )
        xi, xi_dot, now = float(result.y[0, -1]), float(result.y[1, -1]), float(result.t[-1])
        if result.status != 1:
            return xi, xi_dot
        xi_dot = 0.0


def _largest_error(points: NDArray[np.float64]) -> float:
    worst = 0.0
    for (beta, sigma), trace in zip(points, _states(points), strict=True):
        for xi, xi_dot in trace:
            arguments = (float(xi), float(xi_dot), 1.0, -(math.floor(xi) + 0.5), MU, float(beta), float(sigma))
            worst = max(worst, relative_error(propagate(*arguments), exact_reference(*arguments), *arguments[:3]))
    return worst


def measure(quick: bool) -> list[Figure]:
    """Cost of a period, its ratio to solve_ivp's, and the largest error."""
    grid = _grid(np.linspace(1.5 / 34, 1.5, 34), np.linspace(3.0 / 21, 3.0, 21))
    sample = grid[:: 119 if quick else 34].copy()
    traces = _states(sample)
    # The same periods over and over: one round of them is too short for the clock.
    repeated = np.tile(sample, (_REPEATS, 1))
    states = _states(repeated)
    blocks = 2 if quick else 9
    exact_ns: list[float] = []
    scipy_ns: dict[str, list[float]] = {name: [] for name in TOLERANCES}
    for _ in range(blocks):
        begin = time.perf_counter_ns()
        _follow(repeated, states)
        exact_ns.append((time.perf_counter_ns() - begin) / (states.size / 2))
        for name, rtol in TOLERANCES.items():
            begin = time.perf_counter_ns()
            for (beta, sigma), trace in zip(sample, traces, strict=True):
                for xi, xi_dot in trace:
                    _solve_period(xi, xi_dot, beta, sigma, rtol)
            scipy_ns[name].append((time.perf_counter_ns() - begin) / (traces.size / 2))
    progress(f"{blocks} blocks of {traces.size // 2} periods, each {_REPEATS} times by the closed form")

    figures = [Figure("one period, closed form", statistics.median(exact_ns), "ns", details={"blocks_ns": exact_ns})]
    for goal, (name, costs) in zip((RATIO_GOAL, None), scipy_ns.items(), strict=True):
        ratio = statistics.median(cost / own for cost, own in zip(costs, exact_ns, strict=True))
        details = {"solve_ivp_us": statistics.median(costs) / 1e3, "blocks_ns": costs}
        figures.append(Figure("times faster", ratio, "×", goal, "≥", f"solve_ivp with events, {name}", details))
    with_tiny = _grid(np.array([*_TINY_BETAS, 0.1, 1.5]), np.array([0.0, 0.5, 3.0]))
    error = max(_largest_error(sample), _largest_error(with_tiny))
    periods = (len(sample) + len(with_tiny)) * PERIODS
    peer = "mpmath at 60 digits, relative to max(|x|, |v|T)"
    figures.append(Figure("largest error", error, "", ERROR_GOAL, "≤", peer, {"periods": periods}))
    return figures
