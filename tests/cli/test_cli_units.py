"""Units on the command line: the same motion, however it is written."""

from __future__ import annotations

import pytest

from .conftest import Run

COARSE = ("--set", "encoder.decimation=217")


def test_simulate_takes_angles_and_milliseconds(hapticd: Run) -> None:
    in_ticks = hapticd("simulate", "--duration", "0.05", "--deflection", "20.3", *COARSE, "--json").document
    counts = str(20.3 * 217)
    as_counts = hapticd("simulate", "--duration", "50ms", "--deflection", f"{counts}counts", *COARSE, "--json").document
    assert as_counts["ticks"] == 50
    assert as_counts["final"]["position_ticks"] == pytest.approx(in_ticks["final"]["position_ticks"], rel=1e-9)


def test_an_angle_stays_the_same_motion_when_the_decimation_changes(hapticd: Run) -> None:
    speeds = [
        hapticd("check", "--deflection", "30deg", "--set", f"encoder.decimation={n}", "--json").document["xi_dot_max"]
        * n
        for n in (217, 434)
    ]
    assert speeds[0] == pytest.approx(speeds[1], rel=0.05)
    in_ticks = [
        hapticd("check", "--deflection", "20", "--set", f"encoder.decimation={n}", "--json").document["xi_dot_max"] * n
        for n in (217, 434)
    ]
    assert in_ticks[1] > 1.9 * in_ticks[0]


def test_check_takes_a_speed(hapticd: Run) -> None:
    asked = hapticd("check", "--velocity", "60rpm", "--json").document["xi_dot_max"]
    assert asked == pytest.approx(hapticd("check", "--velocity", str(8192 / 1000), "--json").document["xi_dot_max"])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("check", "--deflection", "2mm"), "the device is rotary"),
        (("simulate", "--duration", "1", "--velocity", "2rad"), "is not a velocity"),
        (("simulate", "--duration", "-5ms"), "'-5ms' is not above zero"),
        (("simulate", "--duration", "5weeks"), "unknown unit 'weeks'"),
        (("simulate", "--duration", "1", "--deflection", "0,5rad"), "the decimal sign is a point: 0.5rad"),
    ],
)
def test_what_is_refused(hapticd: Run, words: tuple[str, ...], said: str) -> None:
    outcome = hapticd(*words)
    assert (outcome.code, outcome.out) == (2, "")
    assert said in outcome.err
