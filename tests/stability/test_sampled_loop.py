"""The exact loop: bare against whole, and held against the linear loop and the servo in virtual time."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from hapticd.config import parse_config
from hapticd.servo.simulate import simulate
from hapticd.stability.criterion import lambda_
from hapticd.stability.damping import Damper, damper_from_config
from hapticd.stability.escape import linear_loop
from hapticd.stability.numbers import Dimensionless, loop_from_config
from hapticd.stability.outcome import DECAYING, GROWING, OUTCOMES, PERSISTENT
from hapticd.stability.sampled_loop import CREEP, ESCAPED, HORIZON, LEFT, RECURRED, REST, run_loops
from hapticd.stability.whole_loop import is_bare, record_of

from .motion import loop_record

UNDAMPED = Damper(0.0)
PERIODS = 50_000
RIG: dict[str, Any] = {
    "servo": {"rate_hz": 100},
    "encoder": {"decimation": 217},
    "amplifier": {"dac_bits": 0, "peak_current": None, "continuous_current": None},
}


def bare_and_whole(tau_d: float, search: int) -> tuple[Any, Any]:
    """Runs of the same loops by either compilation of the kernel: a peak current beyond any force makes a loop not bare."""
    beta, sigma, xi_dot = (
        a.ravel() for a in np.meshgrid([0.2, 0.7, 1.2, 2.4], [0.3, 0.5, 0.9, 2.0], [0.05, 5.0, 40.0])
    )
    loops = loop_record(Dimensionless(100.0, 0.0, 0.0, tau_d), UNDAMPED, np.full(beta.size, 0.3), xi_dot)
    loops["beta"], loops["sigma"], loops["search"] = beta, sigma, search
    loops["known"], loops["past"] = np.arange(beta.size) % 2 == 0, xi_dot
    whole = loops.copy()
    whole["clip"] = 1e15
    assert is_bare(loops).all()
    assert not is_bare(whole).any()
    return run_loops(loops, 20_000), run_loops(whole, 20_000)


@pytest.mark.parametrize("tau_d", [0.0, 0.4, 1.25])
def test_a_bare_loop_is_the_whole_one_with_nothing_more_in_it(tau_d: float) -> None:
    bare, whole = bare_and_whole(tau_d, search=0)
    np.testing.assert_array_equal(np.maximum(bare["outcome"], DECAYING), np.maximum(whole["outcome"], DECAYING))
    assert {REST, LEFT} <= set(bare["reason"].tolist())
    for name in ("rose", "xi", "xi_dot", "amplitude", "omega", "periods"):
        goes_on = whole["reason"] != REST
        np.testing.assert_array_equal(bare[name][goes_on], whole[name][goes_on], err_msg=name)
    rests = whole["reason"] == REST
    np.testing.assert_allclose(bare["xi"][rests], whole["xi"][rests], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("tau_d", [0.0, 1.25])
def test_what_is_certain_of_a_bare_loop_comes_true_in_the_whole_one_and_sooner(tau_d: float) -> None:
    bare, whole = bare_and_whole(tau_d, search=512)
    escaped, rests = bare["reason"] == ESCAPED, bare["reason"] == REST
    assert escaped.any()
    assert rests.any()
    assert (whole["outcome"][escaped] == GROWING).all()
    assert ((whole["outcome"][rests] < PERSISTENT) | (whole["amplitude"][rests] < CREEP)).all()
    assert bare["periods"].sum() < whole["periods"].sum()
    at_least_as_soon = bare["periods"] <= whole["periods"]
    assert at_least_as_soon[~escaped].all()


def test_a_cycle_is_measured_over_itself() -> None:
    loops = loop_record(Dimensionless(100.0, 0.75, 0.2), UNDAMPED, np.zeros(2), np.full(2, 0.05))
    loops["search"] = 50_000
    loops["clip"][1] = 1e15
    bare, whole = run_loops(loops, 50_000)
    for found in (bare, whole):
        assert found["reason"] == RECURRED
        assert found["cycle"] > 0
    assert (bare["amplitude"], bare["omega"]) == (whole["amplitude"], whole["omega"])
    loops["search"] = 0
    for later in run_loops(loops, 50_000):
        assert later["reason"] == HORIZON
        assert later["amplitude"] == pytest.approx(bare["amplitude"], rel=1e-12)
        assert later["omega"] == pytest.approx(bare["omega"], rel=1e-3)


@pytest.mark.parametrize("counts", [1, 217])
def test_the_controller_stops_what_grows_and_not_what_cannot_rest(counts: int) -> None:
    beta, sigma = (axis.ravel() for axis in np.meshgrid([0.25, 0.5, 1.0, 1.5], [0.35, 0.7, 1.4, 2.1, 2.8]))
    loops = loop_record(Dimensionless(100.0, 0.0, 0.0), UNDAMPED, np.zeros(beta.size), np.full(beta.size, 10.0))
    loops["beta"], loops["sigma"] = beta, sigma
    bare = run_loops(loops, 4000)["outcome"]
    assert (bare == GROWING).any()
    loops["counts"], loops["stiffest"] = counts, 2.0 * float(lambda_(0.0))
    outcome = run_loops(loops, 4000)["outcome"]
    assert (outcome[sigma < 0.5] == PERSISTENT).all()
    assert (outcome[(sigma >= 0.5) & (bare >= PERSISTENT)] < PERSISTENT).all()


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
    for name in ("tau_d", "natural", "ratio"):  # the amplifier is its current loop
        loops[name] = record_of(config, loop)[name]
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
