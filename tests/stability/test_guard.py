"""What the guard admits and refuses, held against regions and the simulator."""

from __future__ import annotations

from typing import Any

import pytest

from hapticd.config import Config, parse_config
from hapticd.servo.simulate import simulate
from hapticd.stability.guard import Judgement, judge, same_loop
from hapticd.stability.regions import region

RUNAWAY = {"encoder": {"decimation": 217}, "spring": {"stiffness": 0.5}}
SLOW = {"servo": {"rate_hz": 100}, "encoder": {"decimation": 217}}


def config(guard: str = "refuse", **sections: Any) -> Config:
    return parse_config({**sections, "safety": {"guard": guard}}, "test")


def keys(found: Judgement) -> list[str]:
    return [each["key"] for each in found.remedies]


def test_the_default_policy_is_to_refuse() -> None:
    assert parse_config({}, "test").safety.guard == "refuse"


def test_a_stiff_coarse_spring_is_refused_with_what_would_help() -> None:
    found = judge(config(**RUNAWAY), 0.0)
    assert (found.verdict, found.region) == ("refused", "C")
    assert "oscillations grow from the smallest motion" in found.reason
    assert (found.remedies[0]["key"], found.remedies[0]["after"]) == ("spring.stiffness", 0.0156)
    assert found.help == ""


@pytest.mark.parametrize(
    ("deflection", "verdict", "where"), [(None, "admitted", "D|E"), (2.3, "admitted", "E"), (10.3, "refused", "D")]
)
def test_the_speed_limit_divides_d_from_e(deflection: float | None, verdict: str, where: str) -> None:
    found = judge(config(**SLOW), 0.0, deflection=deflection)
    assert (found.verdict, found.region) == (verdict, where)
    assert "the speed limit is 18.9 rad/s" in found.reason


def test_a_smaller_release_is_advised_only_where_it_can_be_asked_for() -> None:
    fast = {"deflection": 10.3}
    devices = config(**SLOW, plant={"coulomb": 0.0022})
    assert "deflection" in keys(judge(devices, 0.0, **fast, release=True))
    assert "deflection" not in keys(judge(devices, 0.0, **fast))


def test_a_buzz_below_one_tick_is_admitted_and_a_larger_one_is_not() -> None:
    buzz = config(encoder={"decimation": 2172})
    assert region_of(buzz) == "B"
    found = judge(buzz, 0.0, deflection=3.3)
    assert (found.verdict, found.region) == ("admitted", "B")
    assert "stay below one tick" in found.reason
    # β just above ½ + τ_D, hardly any Coulomb friction, little inertia: the ladder of cycles above one tick
    ladder = config(encoder={"decimation": 2172}, plant={"inertia": 3.6e-8, "viscous": 7.2e-6, "coulomb": 2e-4})
    assert region_of(ladder) == "B"
    found = judge(ladder, 0.0, deflection=3.3)
    assert found.verdict == "refused"
    assert "starts moved on" in found.reason


def region_of(given: Config) -> str:
    from hapticd.stability.numbers import from_config

    return region(from_config(given))


def test_between_the_delay_and_lambda_a_fast_motion_is_explored() -> None:
    """It could gain energy by stop-and-go motion in step with the servo, which nothing here does; a slow one cannot."""
    late = config(
        amplifier={"bandwidth_hz": 0, "dac_bits": 0},
        delay={"computation_s": 1.25e-3},
        plant={"inertia": 1.2e-6, "viscous": 2.112e-5, "coulomb": 5.52233084e-6},
    )
    found = judge(late, 0.0, velocity=20.0)
    assert (found.verdict, found.region) == ("admitted", "F2")
    assert "starts moved on: fewer than" in found.reason
    assert judge(late, 0.0, velocity=3.0).region == "F1"
    assert (judge(late, 0.0).verdict, judge(late, 0.0).region) == ("admitted", "F1|F2")


def test_the_drivers_latency_counts() -> None:
    assert judge(config(spring={"stiffness": 0.012}), 0.0).region == "F1"
    assert judge(config(spring={"stiffness": 0.012}), 0.001).region == "D|E"


@pytest.mark.parametrize(
    ("guard", "force", "verdict"),
    [("refuse", False, "refused"), ("refuse", True, "forced"), ("warn", False, "warned"), ("off", False, "off")],
)
def test_policies_and_force(guard: str, force: bool, verdict: str) -> None:
    found = judge(config(guard, **RUNAWAY), 0.0, force=force)
    assert found.verdict == verdict
    assert found.document["force"] is (verdict == "forced")


def test_force_says_nothing_of_a_spring_that_needs_none() -> None:
    assert judge(config(), 0.0, deflection=20.3, force=True).verdict == "admitted"


CASE_D: dict[str, Any] = {**SLOW, "spring": {"damping": 3e-4}}


def test_with_damping_the_exact_loop_decides() -> None:
    """Case d of Fig. 8 grows; with a damper it dies out, and with too much of one it shakes."""
    assert judge(config(**SLOW), 0.0, deflection=10.3).verdict == "refused"
    calm = judge(config(**CASE_D), 0.0, deflection=10.3)
    assert (calm.verdict, calm.region) == ("admitted", "D")
    assert "starts moved on: fewer than" in calm.reason
    shaking = judge(config(**SLOW, spring={"damping": 3e-3}), 0.0, deflection=10.3, release=True)
    assert shaking.verdict == "refused"
    assert "spring.damping" in keys(shaking)
    ideal = {"dac_bits": 0}  # a converter's end would end the growth
    assert (
        simulate(config(**SLOW, amplifier=ideal, spring={"damping": 3e-3}), 1.0, deflection=10.3)["outcome"]
        == "growing"
    )


def test_too_much_damping_is_told_where_the_spring_alone_is_calm() -> None:
    """The grip that the spring alone would need is none at all, and nothing that could be rounded."""
    shaking = judge(config(**SLOW, spring={"damping": 3e-3}), 0.0, deflection=2.3)
    assert (shaking.verdict, shaking.region) == ("refused", "E")
    assert "spring.damping" in keys(shaking)
    assert "hand.damping" not in keys(shaking)


def test_damping_without_a_spring_is_looked_at() -> None:
    assert judge(config(spring={"stiffness": 0.0, "damping": 1e-4}), 0.0).verdict == "admitted"
    assert judge(config(spring={"stiffness": 0.0, "damping": 0.05}), 0.0).verdict == "refused"


@pytest.mark.parametrize("key", ["damping", "velocity_periods", "stiffness"])
def test_a_change_of_the_damper_is_a_change_of_the_loop(key: str) -> None:
    old = config(spring={"damping": 1e-4})
    assert same_loop(old, config(spring={"damping": 1e-4}), 0.0)
    assert not same_loop(old, config(spring={"damping": 1e-4, key: 2}), 0.0)


def test_no_spring_is_no_danger() -> None:
    assert judge(config(spring={"stiffness": 0.0}), 0.0, deflection=1e6).verdict == "admitted"


def test_a_motion_beyond_floating_point_is_refused() -> None:
    found = judge(config(**SLOW), 0.0, deflection=1e200)
    assert found.verdict == "refused"
