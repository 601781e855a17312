"""Before a start and a live change the loop is run ahead: what would pass a limit is refused, with value and limit."""

from __future__ import annotations

from typing import Any

import pytest

from hapticd.config import Config, apply_settings, parse_config
from hapticd.service.prediction import Motion, predict, weigh
from hapticd.servo import faults
from hapticd.servo.simulate import simulate
from hapticd.stability.guard import judge


def at(config: Config, place: float, **motion: Any) -> Motion:
    """The shaft at a place, rad."""
    return Motion(round(place / config.raw_resolution), **motion)


def test_a_start_far_away_trips_in_advance_and_one_nearby_does_not() -> None:
    config = Config()
    near, far = (predict(config, 0, at(config, place)) for place in (1.0, 9.9))
    assert near.fault == 0
    assert near.peak_speed < far.peak_speed
    assert far.fault == faults.OVER_SPEED
    assert abs(far.value) > far.limit == 400.0
    assert far.stored_energy == pytest.approx(0.5 * 0.012 * 9.9**2, rel=1e-3)
    assert far.peak_current == pytest.approx(0.012 * 9.9 / 0.0292, rel=1e-3)
    assert far.excursion == pytest.approx(9.9, rel=1e-3)


def test_held_and_let_go_is_the_release_that_simulate_shows() -> None:
    config = Config()
    found = predict(config, 0, at(config, 5.0))
    report = simulate(config, 0.5, deflection=round(5.0 / config.raw_resolution) + 0.5, safety=True)
    assert found.peak_speed == pytest.approx(report["motion"]["peak_velocity"], rel=1e-9)
    assert found.peak_current == pytest.approx(report["peak_current_A"], rel=1e-9)


def test_a_soft_start_left_alone_is_gentler() -> None:
    config = parse_config({"safety": {"max_velocity": 300}}, "test")
    at_once = apply_settings(config, {"safety.soft_start_s": 0}, source="test")
    assert predict(at_once, 0, at(config, 9.0)).held is False
    soft = predict(config, 0, at(config, 9.0))
    assert soft.held is True, "left alone it does not trip, but let go it does"
    assert soft.fault == faults.OVER_SPEED


@pytest.mark.parametrize(
    ("change", "motion", "fault"),
    [
        ({"spring.stiffness": 0.013}, {"speed": 100.0}, 0),
        ({"spring.stiffness": 0.013}, {"speed": -399.9}, faults.OVER_SPEED),
        ({"spring.stiffness": 0.013}, {"speed": 399.9}, faults.EXCURSION),
        ({"spring.origin": -6.0}, {}, faults.EXCURSION),
        ({"safety.max_velocity": 90}, {"speed": 100.0}, faults.OVER_SPEED),
        (
            {"amplifier.peak_time_s": 0.01, "spring.stiffness": 1.0, "encoder.decimation": 1},
            {"i2t": 0.3},
            faults.OVER_CURRENT,
        ),
    ],
)
def test_a_live_change_is_judged_from_the_motion_at_hand(
    change: dict[str, Any], motion: dict[str, float], fault: int
) -> None:
    rendered = Config()
    data = rendered.model_dump()
    for key, value in change.items():
        section, name = key.split(".")
        data[section][name] = value
    config = parse_config(data, "test")
    found = predict(config, config.origin_counts, at(config, 4.5, before=(rendered, 0), **motion))
    assert found.fault == fault


@pytest.mark.parametrize(
    ("policy", "force", "verdict"),
    [
        ("refuse", False, "refused"),
        ("refuse", True, "forced"),
        ("warn", False, "warned"),
        ("warn", True, "warned"),
        ("off", False, "off"),
    ],
)
def test_force_and_policy_override_it_as_they_do_theory(policy: str, force: bool, verdict: str) -> None:
    config = parse_config({"safety": {"guard": policy}}, "test")
    prediction = predict(config, 0, at(config, 9.9))
    judgement = weigh(judge(config, 0.0), prediction, config, force)
    assert judgement.verdict == verdict
    if policy == "off":
        assert judgement.predicted is None
        return
    assert judgement.trips
    assert judgement.predicted == prediction.document
    assert f"{prediction.value:.4g} rad/s is above safety.max_velocity = 400" in judgement.reason
    assert judgement.document["predicted"]["fault"] == "over_speed"


def test_what_does_not_trip_leaves_theory_its_word() -> None:
    config = Config()
    said = judge(config, 0.0, deflection=1.0)
    weighed = weigh(said, predict(config, 0, at(config, 1.0)), config, False)
    assert (weighed.verdict, weighed.reason, weighed.trips) == (said.verdict, said.reason, False)
    assert weighed.predicted is not None
    assert weighed.predicted["fault"] is None
