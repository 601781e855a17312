"""The eight region maps of Fig. 6 and 7: time, agreement with theory, and the cost and error of one period beside peers.

The peers solve the same periods, each started from the exact state at its sample, so that speed and error belong together:
scipy's solve_ivp with the velocity's zero as an event, and MuJoCo with a slide joint of the same damping and frictionloss,
at 1, 10 and 100 steps a period. MuJoCo is optional: ``pip install mujoco``.
"""

from __future__ import annotations

import importlib
import math
import os
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Figure, progress
from hapticd.plant.exact import propagate
from hapticd.stability import map_engines, map_report, map_store
from hapticd.stability.maps import Maps, Study, run_points
from tests.plant.reference import exact_reference, integrate, relative_error

SECONDS_GOAL = 3.0
CHANGED_GOAL = 1.0
_STEPS = (1, 10, 100)
_MJCF = """<mujoco><option timestep="{step}" gravity="0 0 0" integrator="implicitfast"/><worldbody><body>
<joint name="shaft" type="slide" axis="1 0 0" damping="{beta}" frictionloss="{sigma}"/>
<geom size="0.1" mass="{mu}" contype="0" conaffinity="0"/></body></worldbody>
<actuator><motor joint="shaft"/></actuator></mujoco>"""

Period = tuple[float, float, float, float, float]
"""ξ, ξ̇, φ, β, σ at the start of a period."""
Solver = Callable[[Period], tuple[float, float]]


def _eight(study: Study, jobs: int | None = None) -> tuple[Maps, float]:
    maps = Maps(study)
    begin = time.perf_counter()
    map_store.fill(maps, lambda chunks: map_engines.local(chunks, jobs), None)
    return maps, time.perf_counter() - begin


def _changed(first: Maps, second: Maps) -> float:
    """Points with another outcome, in percent."""
    return 100.0 * float(np.mean(first.points["outcome"] != second.points["outcome"]))


def _to_the_horizon(study: Study) -> float:
    """Nanoseconds a period when no run may end early, over all points of the study that stay below 10⁹ ticks."""
    spent, periods = 0.0, 0
    for tau_d in study.delays:
        beta, sigma = (a.ravel() for a in np.meshgrid(study.betas(tau_d), study.sigmas, indexing="ij"))
        for velocity in study.velocities:
            begin = time.perf_counter()
            points = run_points(
                study.mu, beta, sigma, tau_d, np.full(beta.size, velocity), study.periods, early=False
            )  # fmt: skip
            spent += time.perf_counter() - begin
            periods += int(points["periods"].sum())
    return spent / periods * 1e9


def _periods(study: Study, count: int) -> list[Period]:
    """Periods of Fig. 6, spread over the grid and over the run."""
    rng = np.random.default_rng(6)
    found: list[Period] = []
    while len(found) < count:
        beta, sigma = float(rng.choice(study.betas(0.0))), float(rng.choice(study.sigmas))
        xi, xi_dot = 0.0, float(rng.choice(study.velocities))
        for _ in range(int(rng.integers(0, 300))):
            xi, xi_dot = propagate(xi, xi_dot, 1.0, -math.floor(xi) - 0.5, study.mu, beta, sigma)
        if xi_dot != 0.0:
            found.append((xi, xi_dot, -math.floor(xi) - 0.5, beta, sigma))
    return found


def _scipy(mu: float, rtol: float) -> Solver:
    def solve(period: Period) -> tuple[float, float]:
        xi, xi_dot, force, beta, sigma = period
        return integrate(xi, xi_dot, 1.0, force, mu, beta, sigma, rtol=rtol)

    return solve


def _mujoco(mujoco: Any, mu: float, steps: int) -> Solver:
    model = mujoco.MjModel.from_xml_string(_MJCF.format(step=1.0 / steps, beta=0.0, sigma=1.0, mu=mu))
    data = mujoco.MjData(model)

    def solve(period: Period) -> tuple[float, float]:
        data.qpos[0], data.qvel[0], data.ctrl[0], model.dof_damping[0], model.dof_frictionloss[0] = period
        mujoco.mj_step(model, data, nstep=steps)
        return float(data.qpos[0]), float(data.qvel[0])

    return solve


def _cost_and_error(solve: Solver, periods: list[Period], mu: float, blocks: int) -> tuple[float, NDArray[np.float64]]:
    """Nanoseconds a period (median of blocks) and every period's error, relative to max(|ξ|, |ξ̇|)."""
    costs = []
    for _ in range(blocks):
        begin = time.perf_counter_ns()
        for period in periods:
            solve(period)
        costs.append((time.perf_counter_ns() - begin) / len(periods))
    errors = [_error(solve(period), period, mu) for period in periods]
    return statistics.median(costs), np.array(errors)


def _error(got: tuple[float, float], period: Period, mu: float) -> float:
    xi, xi_dot, force, beta, sigma = period
    return relative_error(got, exact_reference(xi, xi_dot, 1.0, force, mu, beta, sigma), xi, xi_dot, 1.0)


def _peers(mu: float) -> dict[str, Solver]:
    peers = {f"solve_ivp with events, rtol {rtol:g}": _scipy(mu, rtol) for rtol in (1e-3, 1e-11)}
    try:
        mujoco = importlib.import_module("mujoco")
    except ImportError:
        progress("MuJoCo is not installed and not compared; to compare it: pip install mujoco")
        return peers
    return peers | {f"MuJoCo implicitfast, period/{steps}": _mujoco(mujoco, mu, steps) for steps in _STEPS}


def measure(quick: bool) -> list[Figure]:
    """Time and agreement of the maps; cost and error of a period."""
    study = Study()
    _eight(Study(periods=100))
    cores = len(os.sched_getaffinity(0))
    runs = [_eight(study) for _ in range(3 if quick else 7)]
    alone = [_eight(study, 1)[1] for _ in range(3)]
    maps, spent = runs[0][0], [seconds for _, seconds in runs]
    report = map_report.report(maps)
    changed = _changed(maps, _eight(Study(periods=2 * study.periods))[0])
    changed_short = _changed(*(_eight(Study(periods=n))[0] for n in (3000, 6000)))
    details = {"runs_s": spent, "one_thread_s": alone, "periods_simulated": int(maps.points["periods"].sum())}
    figures = [
        Figure(
            f"eight maps on {cores} cores", statistics.median(spent), "s", SECONDS_GOAL, "≤", "after compilation", details
        ),
        Figure("eight maps on one core", statistics.median(alone), "s"),
        Figure("points that contradict their region", len(report["exceptions"]), "", 0.0, "≤", details=report["regions"]),
        Figure("points of B at or above one tick", len(report["b_one_tick"]), "", details={"listed": report["b_one_tick"]}),
        Figure("outcomes changed by twice the horizon", changed, "%", CHANGED_GOAL, "≤", "1e5 periods"),
        Figure("the same from 3000 to 6000", changed_short, "%", CHANGED_GOAL, "≤", "6000 periods"),
    ]  # fmt: skip
    own = _to_the_horizon(Study(periods=5_000 if quick else 50_000))
    figures.append(Figure("one period, no early end, one core", own, "ns"))
    sample = _periods(study, 60 if quick else 400)
    exact = [_error(propagate(p[0], p[1], 1.0, p[2], study.mu, p[3], p[4]), p, study.mu) for p in sample]
    figures.append(Figure("its largest error", max(exact), "", 1e-12, "≤", "mpmath at 60 digits"))
    for name, solve in _peers(study.mu).items():
        cost, errors = _cost_and_error(solve, sample, study.mu, 3)
        progress(
            f"{name}: {cost / 1e3:.3g} µs a period, error {errors.max():.2g} at most, {np.median(errors):.2g} median"
        )
        more = {
            "us_a_period": cost / 1e3,
            "largest_error": float(errors.max()),
            "median_error": float(np.median(errors)),
        }
        figures.append(Figure("times faster a period", cost / own, "×", peer=name, details=more))
        figures.append(Figure("its largest error", float(errors.max()), "", peer=name, details=more))
    return figures
