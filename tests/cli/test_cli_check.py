"""``hapticd check``: keys, exit codes, device names, figure, and what it refuses."""

from __future__ import annotations

import math
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from hapticd.stability.criterion import lambda_

from .conftest import Run

BOARDS = {"board": "tests.servo.scripted:Slow", "lost": "no_lab:Board"}
RIG = ("--set", "amplifier.bandwidth_hz=0", "--set", "amplifier.dac_bits=0", "--set", "encoder.decimation=217")
SLOW = (*RIG, "--set", "servo.rate_hz=100")


def test_json_has_the_public_keys(hapticd: Run) -> None:
    outcome = hapticd("check", *RIG, "--deflection", "20.3", "--json")
    found = outcome.document
    assert (outcome.code, outcome.err) == (0, "")
    assert found.keys() >= {
        "mu",
        "beta",
        "sigma",
        "tau_d",
        "region",
        "xi_dot_max",
        "criterion_margin",
        "stiffness_max",
        "limit_cycle",
        "sampling_bound_ok",
        "warnings",
    }
    assert found["criterion_margin"].keys() == {"paper"}
    assert found["stiffness_max"].keys() == {"passive", "dissipating"}
    assert found["limit_cycle"].keys() >= {"predicted", "amplitude_ticks", "frequency_hz"}
    assert (found["mu"], found["beta"]) == pytest.approx((523.3, 0.75), rel=1e-3)
    assert (found["sigma"], found["tau_d"], found["region"]) == (pytest.approx(1.0014, rel=1e-4), 0.0, "A")
    assert found["limit_cycle"]["amplitude_ticks"] is None


@pytest.mark.parametrize(
    ("words", "region", "code"),
    [
        ((*RIG, "--deflection", "20.3"), "A", 0),
        ((*RIG, "--set", "encoder.decimation=2172", "--deflection", "3.3"), "B", 1),
        ((*SLOW, "--deflection", "2.3"), "E", 0),
        ((*SLOW, "--deflection", "10.3"), "D", 1),
        ((*SLOW, "--velocity", "-0.5"), "E", 0),
        ((*SLOW, "--velocity", "5"), "D", 1),
        (SLOW, "D|E", 0),
        ((*SLOW, "--set", "encoder.decimation=1000"), "C", 1),
        ((*RIG, "--set", "delay.computation_s=0.0001"), "F1", 0),
        ((*RIG, "--set", "delay.computation_s=0.0001", "--deflection", "20.3"), "F1", 0),
    ],
)
def test_the_exit_code_is_the_verdict(hapticd: Run, words: tuple[str, ...], region: str, code: int) -> None:
    decimations = [word for word in words if word.startswith("encoder.decimation")]
    if len(decimations) > 1:  # the last one counts
        first = words.index(decimations[0])
        words = (*words[: first - 1], *words[first + 1 :])
    outcome = hapticd("check", *words, "--json")
    assert (outcome.document["region"], outcome.code) == (region, code)


def test_infinite_and_missing_numbers_are_null(hapticd: Run) -> None:
    found = hapticd("check", "--set", "spring.stiffness=0", "--json").document
    assert [found[key] for key in ("mu", "beta", "sigma", "xi_dot_max", "velocity_limit")] == [None] * 5
    assert found["stiffness_max"] == {"passive": pytest.approx(0.01493, rel=1e-3), "dissipating": None}
    assert hapticd("check", "omega", "--json").document["stiffness_max"]["dissipating"] is None


def test_advice_in_json_and_in_words(hapticd: Run) -> None:
    changes = hapticd("check", *SLOW, "--deflection", "10.3", "--json").document["changes"]
    assert {"key": "servo.rate_hz", "before": 100.0, "unit": "Hz"}.items() <= changes[1].items()
    again = hapticd("check", *RIG, "--set", f"servo.rate_hz={changes[1]['after']}", "--json")
    assert again.document["beta"] == pytest.approx(0.075 * changes[1]["after"] / 100.0, rel=1e-3)
    outcome = hapticd("check", *SLOW, "--deflection", "10.3")
    assert outcome.code == 1
    assert outcome.out.startswith("re35, released at rest from 10.3 ticks: not stable")
    assert "servo.rate_hz        100 → 270 Hz" in outcome.out


@pytest.mark.parametrize("name", ["freedom6", "Freedom 6", "FREEDOM-6"])
def test_devices_of_table_ii_by_any_spelling(hapticd: Run, name: str) -> None:
    outcome = hapticd("check", name, "--json")
    assert outcome.code == 0
    by_quantity = {row["quantity"]: row for row in outcome.document["table_ii"]}
    assert by_quantity["beta"]["printed"] == 0.025
    assert by_quantity["beta"]["recomputed"] == pytest.approx(0.004167, rel=1e-3)
    assert "Table II, Freedom 6" in hapticd("check", name).out


def test_a_file_is_not_mistaken_for_a_device(hapticd: Run, tmp_path: Path) -> None:
    path = tmp_path / "omega"
    path.write_text("encoder: {decimation: 217}\n")
    outcome = hapticd("check", str(path), "--json")
    assert "table_ii" not in outcome.document
    assert outcome.document["sigma"] == pytest.approx(1.0014, rel=1e-4)


def test_the_drivers_declared_latency_is_added(hapticd: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    entries = {name: EntryPoint(name, value, "hapticd.drivers") for name, value in BOARDS.items()}
    monkeypatch.setattr("drivers.registry.installed_drivers", lambda: entries)
    found = hapticd("check", *RIG, "--set", "driver.name=board", "--json").document
    assert found["tau_d"] == pytest.approx(10.0)
    missing = hapticd("check", *RIG, "--set", "driver.name=bord", "--json").document
    assert missing["tau_d"] == 0.0
    assert any("driver 'bord' is not installed" in warning for warning in missing["warnings"])
    assert "cannot be loaded (ModuleNotFoundError: No module named 'no_lab')" in (
        hapticd("check", *RIG, "--set", "driver.name=lost").out
    )


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_a_figure_is_written(hapticd: Run, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"plane.{suffix}"
    outcome = hapticd("check", *SLOW, "--deflection", "10.3", "-o", str(path), "--json")
    assert (outcome.code, outcome.document["figure"]) == (1, str(path))
    head = path.read_bytes()[:200]
    assert head.startswith(b"\x89PNG") if suffix == "png" else b"<?xml" in head


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--velocity", "1", "--deflection", "1"), "exclude each other"),
        (("-o", "plane.jpeg"), "plane.jpeg: a figure is a .pdf, .png, .svg file"),
        (("-o", "/no/such/folder/x.png"), "there is no folder /no/such/folder"),
        (("-o", "x.png", "--set", "spring.stiffness=0"), "no operating point to draw"),
        (("omege",), "did you mean omega?"),
        (("--velocity", "fast"), "is not a number"),
    ],
)
def test_what_cannot_be_meant_exits_2(hapticd: Run, words: tuple[str, ...], said: str) -> None:
    outcome = hapticd("check", *words)
    assert (outcome.code, outcome.out) == (2, "")
    assert said in outcome.err


def test_nothing_is_proven_outside_the_theory(hapticd: Run) -> None:
    motion = (*RIG, "--deflection", "20.3", "--json")
    assert hapticd("check", *motion).document["proven"]
    assert hapticd("check", *motion, "--set", "spring.side=positive").document["proven"]
    assert hapticd("check", *motion, "--set", "spring.half_tick_bias=false").document["proven"]
    assert not hapticd("check", *motion, "--set", "safety.passivity=control").document["proven"]


def test_a_motion_beyond_floating_point_is_refused(hapticd: Run) -> None:
    refused = hapticd("check", *RIG, "--deflection", "1e200")
    assert refused.code == 2
    assert "is too large to compute" in refused.err


@pytest.mark.parametrize("motion", [(), ("--deflection", "5")])
def test_the_softest_spring_in_the_heaviest_plant_has_an_answer(hapticd: Run, motion: tuple[str, ...]) -> None:
    heaviest = ("inertia", "viscous", "coulomb")
    settings = [word for name in heaviest for word in ("--set", f"plant.{name}=1e18")]
    answer = hapticd("check", "--set", "spring.stiffness=1e-18", *settings, *motion, "--json").document
    assert all(math.isfinite(answer[name]) for name in ("mu", "beta", "sigma"))
    refused = hapticd("check", "--set", "spring.stiffness=1e-19", *motion)
    assert (refused.code, refused.out) == (2, "")
    assert "spring.stiffness = 1.0e-19: must be 0, or of 1e-18 to 1e+18 N m/rad in magnitude" in refused.err


def test_check_says_what_the_daemon_would_do(hapticd: Run) -> None:
    outcome = hapticd("check", *SLOW, "--deflection", "10.3")
    assert "safety.guard: the daemon refuses to render this without --force" in outcome.out
    guard = hapticd("check", *SLOW, "--deflection", "10.3", "--json").document["guard"]
    assert (guard["verdict"], guard["region"]) == ("refused", "D")
    assert "safety.guard" not in hapticd("check", *SLOW, "--deflection", "2.3").out


def test_check_prints_the_bound_and_runs_the_exact_loop(hapticd: Run) -> None:
    case = ("--set", "servo.rate_hz=100", "--set", "encoder.decimation=217", "--deflection", "10.3")
    assert hapticd("check", *case, "--json").document["explored"]["moving_on"] > 0
    answer = hapticd("check", *case, "--set", "spring.damping=3e-4", "--json")
    assert answer.document["explored"]["moving_on"] == 0
    damping = answer.document["damping"]
    assert damping["beta_v"] == pytest.approx(2.5)
    least = 0.012e-2 * float(lambda_(answer.document["tau_d"], 2.5))
    assert damping["passive"]["viscous_least"] == pytest.approx(least)
    assert not damping["passive"]["holds"]


@pytest.mark.parametrize("command", [("check",), ("simulate", "--duration", "0.1"), ("zwidth", "--points", "2")])
@pytest.mark.parametrize(("driver", "near"), [("canopen", "node_id"), ("serial_dac", "port")])
def test_an_option_that_the_driver_does_not_have_is_refused(
    hapticd: Run, command: tuple[str, ...], driver: str, near: str
) -> None:
    outcome = hapticd(*command, "--set", f"driver.name={driver}", "--set", f"driver.{near}s=3")
    assert outcome.code == 2
    assert f"driver.{near}s: driver {driver} has no such option; did you mean driver.{near}?" in outcome.err
