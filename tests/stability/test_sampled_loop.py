"""The exact loop with damping, held against the maps' kernel, the linear loop, and the servo in virtual time."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from hapticd.config import parse_config
from hapticd.servo.simulate import simulate
from hapticd.stability.damping import Damper, damper_from_config
from hapticd.stability.escape import linear_loop
from hapticd.stability.maps import OUTCOMES, run_points
from hapticd.stability.numbers import Dimensionless, loop_from_config
from hapticd.stability.sampled_loop import run_loops
from hapticd.stability.whole_loop import loop_record

UNDAMPED = Damper(0.0)
PERIODS = 50_000
RIG: dict[str, Any] = {
    "servo": {"rate_hz": 100},
    "encoder": {"decimation": 217},
    "amplifier": {"dac_bits": 0, "peak_current": None, "continuous_current": None},
}


@pytest.mark.parametrize("tau_d", [0.0, 1.25])
def test_without_damping_it_is_the_loop_of_the_maps(tau_d: float) -> None:
    beta, sigma = (axis.ravel() for axis in np.meshgrid([0.2, 0.7, 1.2], [0.3, 0.9, 2.0]))
    mapped = run_points(100.0, beta, sigma, tau_d, np.full(9, 5.0), 20_000)
    for point, b, s in zip(mapped, beta, sigma, strict=True):
        loops = loop_record(Dimensionless(100.0, b, s, tau_d), UNDAMPED, np.zeros(1), np.full(1, 5.0))
        run = run_loops(loops, 20_000)[0]
        same = {"monotone": "calm", "decaying": "calm"}
        expected, found = OUTCOMES[point["outcome"]], OUTCOMES[run["outcome"]]
        assert same.get(found, found) == same.get(expected, expected)
        if found in same:
            assert run["xi"] == pytest.approx(point["xi"], abs=1e-9)


@pytest.mark.parametrize(
    "estimate",
    [
        {"velocity_periods": 1},
        {"velocity_periods": 4},
        {"velocity_estimate": "low_pass", "velocity_cutoff_hz": 20.0},
    ],
)
@pytest.mark.parametrize("delay_s", [0.0, 0.0137])
def test_the_servo_does_what_the_exact_loop_does(estimate: dict[str, Any], delay_s: float) -> None:
    config = parse_config({**RIG, "spring": {"damping": 2e-4, **estimate}, "delay": {"computation_s": delay_s}}, "test")
    loop = loop_from_config(config)
    loops = loop_record(loop.numbers, damper_from_config(config, loop), np.array([2.3]), np.zeros(1))
    for periods in (12, 37, 150):
        run = run_loops(loops, periods)[0]
        found = simulate(config, periods / 100.0, deflection=2.3)["final"]
        if run["periods"] == periods:
            assert found["velocity_ticks_per_period"] == pytest.approx(run["xi_dot"], rel=1e-9, abs=1e-8)
        assert found["position_ticks"] == pytest.approx(run["xi"], rel=1e-9, abs=1e-8)


def run(numbers: Dimensionless, damper: Damper, xi: float = 0.0, xi_dot: float = 0.0, linear: bool = False) -> Any:
    """One motion of a loop with ticks and friction, or of the linear one."""
    loops = loop_record(numbers, damper, np.array([xi]), np.array([xi_dot]))
    if linear:
        loops["ticks"], loops["sigma"] = False, 0.0
    return run_loops(loops, PERIODS)[0]


def dies_out(found: Any) -> bool:
    return OUTCOMES[found["outcome"]] in ("monotone", "decaying")


def linear_gain(numbers: Dimensionless, beta_v: float) -> float:
    """Largest eigenvalue of the loop without ticks and friction, its damper a difference over one period."""
    A, b = linear_loop(numbers.mu, numbers.beta, numbers.tau_d)
    size = len(b)
    whole = np.zeros((size + 1, size + 1))
    whole[:size, :size] = A
    whole[:size, 0] -= beta_v * b
    whole[:size, size] = beta_v * b
    whole[size, 0] = 1.0
    return float(np.abs(np.linalg.eigvals(whole)).max())


@pytest.mark.parametrize("tau_d", [0.0, 0.4, 1.25])
def test_linear_stability_is_the_eigenvalues(tau_d: float) -> None:
    judged = 0
    for beta in (0.05, 0.8):
        for beta_v in np.geomspace(0.05, 300.0, 25):
            numbers = Dimensionless(40.0, beta, 0.0, tau_d)
            gain = linear_gain(numbers, beta_v)
            if abs(gain - 1.0) > 1e-3:
                judged += 1
                assert dies_out(run(numbers, Damper(beta_v), xi_dot=1.0, linear=True)) == (gain < 1.0), (
                    beta,
                    beta_v,
                    gain,
                )
    assert judged > 30


def test_a_damper_brakes_what_grows_without_it_and_shakes_when_it_is_too_strong() -> None:
    numbers = Dimensionless(100.0, 0.1, 1.0)
    found = [run(numbers, Damper(b), xi_dot=50.0) for b in (0.0, 1.0, 300.0)]
    assert [OUTCOMES[one["outcome"]] for one in (found[0], found[2])] == ["growing", "growing"]
    assert dies_out(found[1])


def test_a_hands_stiffness_is_in_it() -> None:
    numbers = Dimensionless(100.0, 0.05, 0.0, kappa=3.0)
    found = run(numbers, UNDAMPED, xi=20.0)
    assert found["omega"] == pytest.approx(math.sqrt(4.0 / 100.0), rel=0.05) or OUTCOMES[found["outcome"]] == "growing"
    assert run(Dimensionless(100.0, 5.0, 0.0, kappa=0.0), UNDAMPED, xi=20.0)["amplitude"] < 1.0
