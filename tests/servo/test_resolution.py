"""A trip that an encoder's reading decides goes by what the reading proves: one count less than it shows."""

from __future__ import annotations

import pytest

from hapticd.config import Config, parse_config
from hapticd.servo.simulate import simulate
from hapticd.stability.assessment import assess
from tests.servo.scripted import Scripted, config, core_for, fault_code, rows_of


def linear(deflection_m: float) -> tuple[Config, float]:
    """A carriage with 1 mm a count at 1 kHz whose ticks are 0.98 ms apart, as on a machine that is now late, now early."""
    rig = parse_config(
        {
            "servo": {"rate_hz": 1e6 / 980},
            "encoder": {"counts_per_metre": 1000},
            "spring": {"stiffness": 144.0},
            "amplifier": {"torque_constant": 10.0},
            "plant": {"inertia": 0.5, "viscous": 1.0, "coulomb": 2.0},
        },
        "test",
    )
    return rig, deflection_m / rig.resolution


def test_two_counts_in_a_short_period_are_no_over_speed() -> None:
    rig, ticks = linear(0.1)
    report = simulate(rig, 2.0, deflection=ticks, safety=True)
    assert 1.0 < report["motion"]["peak_velocity"] < rig.safety.max_velocity
    assert report["fault"] is None


def test_an_over_speed_still_is() -> None:
    rig, ticks = linear(0.18)
    free = simulate(rig, 2.0, deflection=ticks)
    assert free["motion"]["peak_velocity"] > 1.2 * rig.safety.max_velocity
    assert simulate(rig, 2.0, deflection=ticks, safety=True)["fault"]["code"] == "over_speed"


@pytest.mark.parametrize(
    ("safety", "quiet", "too_far", "code"),
    [
        ({"encoder_jump": 50}, 51, 52, "encoder_jump"),
        ({"max_velocity": 50 * config().count_speed, "encoder_jump": None}, 51, 52, "over_speed"),
        ({"max_excursion": 150 * config().raw_resolution}, 51, 52, "excursion"),
    ],
)
def test_every_such_trip_allows_the_same_count(safety: dict[str, float], quiet: int, too_far: int, code: str) -> None:
    for jump, expected in ((quiet, None), (too_far, code)):
        for sign in (1, -1):
            driver = Scripted(config(safety=safety), lambda n, way=sign, far=jump: way * (100 if n < 20 else 100 + far))
            core = core_for(driver, driver.config)
            rows_of(core, 40)
            assert fault_code(core) == expected
            if expected:
                value, limit = core.fault_numbers
                assert abs(value) > limit
                assert value * sign > 0.0


def test_check_says_what_one_count_a_period_is() -> None:
    rig, _ = linear(0.1)
    found = assess(rig)
    assert found.document["count_speed"] == pytest.approx(1e-3 / 980e-6)
    assert any("safety.max_velocity = 2 m/s is 1.96 counts per period" in text for text in found.warnings)
    assert not any("counts per period" in text for text in assess(config()).warnings)
