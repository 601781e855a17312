"""``simulate``: the four cases of Fig. 8, bit-identical rows, and what it does without and with safety."""

from __future__ import annotations

import hashlib
import threading
from importlib.metadata import EntryPoint
from typing import Any

import numpy as np
import pytest

from hapticd.servo.simulate import simulate
from tests.servo.scripted import config

SLOW = "tests.servo.scripted:Slow"

CASES = {
    "a": ({"servo": {"rate_hz": 1000}, "encoder": {"decimation": 217}}, 20.3, 3.0, "monotone"),
    "b": ({"servo": {"rate_hz": 1000}, "encoder": {"decimation": 2172}}, 3.3, 20.0, "persistent"),
    "c": ({"servo": {"rate_hz": 100}, "encoder": {"decimation": 217}}, 2.3, 3.0, "monotone"),
    "d": ({"servo": {"rate_hz": 100}, "encoder": {"decimation": 217}}, 10.3, 60.0, "growing"),
}


@pytest.mark.parametrize("case", CASES)
def test_fig_8(case: str) -> None:
    sections, deflection, duration_s, outcome = CASES[case]
    report = simulate(config(**sections), duration_s, deflection=deflection)
    assert report["outcome"] == outcome
    if case == "a":
        assert report["final"]["position_ticks"] == pytest.approx(-0.7251, abs=5e-5)
        assert report["final"]["velocity_ticks_per_period"] == 0.0
    if case == "c":
        assert report["final"]["position_ticks"] == pytest.approx(-0.9322, abs=5e-5)
    if case == "d":
        assert abs(report["final"]["position_ticks"]) > 1e9
        assert report["ticks"] < 6000


def test_without_energies_all_but_the_outcome_is_the_same() -> None:
    sections, deflection, duration_s, _ = CASES["b"]
    reports, rows = [], []
    for energies in (True, False):
        blocks: list[Any] = []
        found = simulate(
            config(**sections), duration_s, deflection=deflection, energies=energies, on_rows=blocks.append
        )
        reports.append({key: value for key, value in found.items() if key not in ("wall_s", "ticks_per_s")})
        rows.append(np.concatenate(blocks))
    assert [report.pop("outcome") for report in reports] == ["persistent", None]
    assert [report.pop("motion") is None for report in reports] == [False, True]
    assert reports[0] == reports[1]
    assert (rows[0] == rows[1]).all()


@pytest.mark.parametrize("case", ["a", "b"])
def test_the_motion_is_that_of_the_true_states(case: str) -> None:
    sections, deflection, duration_s, _ = CASES[case]
    blocks: list[Any] = []
    cfg = config(**sections)
    report = simulate(cfg, duration_s, deflection=deflection, on_truth=lambda truth: blocks.append(truth.copy()))
    position, velocity = np.concatenate(blocks).T
    motion = report["motion"]
    assert motion["peak_deflection"] == pytest.approx(float(np.abs(position).max()))
    assert motion["peak_velocity"] == pytest.approx(float(np.abs(velocity).max()))
    assert report["final"]["position"] == pytest.approx(report["final"]["position_ticks"] * cfg.resolution)
    if report["at_rest"]:
        assert motion["time_to_rest_s"] == pytest.approx((np.flatnonzero(velocity)[-1] + 1) * cfg.period)
    else:
        assert motion["time_to_rest_s"] is None
    moving = np.flatnonzero(velocity)
    turns = moving[1:][np.diff(np.sign(velocity[moving])) != 0.0][-32:]
    assert motion["frequency_hz"] == pytest.approx(0.5 * (turns.size - 1) / ((turns[-1] - turns[0]) * cfg.period))


def test_case_d_with_safety_ends_in_a_latched_fault() -> None:
    sections, deflection, duration_s, _ = CASES["d"]
    report = simulate(config(**sections), duration_s, deflection=deflection, safety=True)
    assert report["fault"]["code"] in {"over_speed", "excursion"}
    assert report["peak_current_A"] <= 6.0


@pytest.mark.parametrize("case", ["a", "b", "c"])
def test_default_safety_limits_admit_the_other_cases(case: str) -> None:
    sections, deflection, duration_s, _ = CASES[case]
    assert simulate(config(**sections), duration_s, deflection=deflection, safety=True)["fault"] is None


def fingerprint(**dither: Any) -> str:
    cfg = config(encoder={"decimation": 50}, dither={"target": "position", "amplitude": 0.4, **dither})
    digest = hashlib.sha256()
    simulate(cfg, 5.0, deflection=8.2, on_rows=lambda rows: digest.update(rows.tobytes()))
    return digest.hexdigest()


def test_same_seed_gives_bit_identical_rows_whatever_else_runs() -> None:
    quiet = fingerprint(waveform="uniform", seed=5)
    stop = threading.Event()

    def burn() -> None:
        while not stop.is_set():
            np.linalg.eigvals(np.random.default_rng(0).random((60, 60)))

    noise = [threading.Thread(target=burn) for _ in range(3)]
    for thread in noise:
        thread.start()
    try:
        assert [fingerprint(waveform="uniform", seed=5) for _ in range(3)] == [quiet] * 3
    finally:
        stop.set()
        for thread in noise:
            thread.join()
    assert fingerprint(waveform="uniform", seed=6) != quiet


def test_deflection_and_velocity_are_exact_and_relative_to_a_snapped_origin() -> None:
    cfg = config(spring={"origin": 0.7}, encoder={"decimation": 217})
    first: list[Any] = []
    result = simulate(cfg, 0.001, deflection=20.3, velocity=0.0, on_rows=lambda rows: first.append(rows.copy()))
    assert result["ticks"] == 1
    row = first[0][0]
    assert row["ticks"] == 20
    assert row["encoder_counts"] == round(0.7 * 8192 / (2 * np.pi)) + int(20.3 * 217)
    moving = simulate(
        config(plant={"viscous": 0.0, "coulomb": 0.0}, spring={"half_tick_bias": False}), 0.003, velocity=0.2
    )
    assert moving["final"]["position_ticks"] == pytest.approx(0.6, rel=1e-12)


@pytest.mark.parametrize("rate_hz", [3000, 640, 997, 1e4 / 3])
def test_odd_rates_keep_their_grid(rate_hz: float) -> None:
    times: list[float] = []
    simulate(config(servo={"rate_hz": rate_hz}), 2.0, on_rows=lambda rows: times.extend(rows["time_s"]))
    assert np.array(times) == pytest.approx(np.arange(len(times)) / rate_hz, abs=2e-15 * 2e9 * 1e-6)


def test_too_short_a_duration_is_refused() -> None:
    with pytest.raises(ValueError, match="shorter than one servo period"):
        simulate(config(), 1e-5)


def test_the_loopback_stands_in_for_any_driver_with_its_declared_latency(monkeypatch: pytest.MonkeyPatch) -> None:
    case_c: dict[str, Any] = {"servo": {"rate_hz": 100}, "encoder": {"decimation": 217}}
    absent = config(**case_c, driver={"name": "board", "port": "/dev/ttyUSB0"})
    report = simulate(absent, 3.0, deflection=2.3)
    assert report["final"]["position_ticks"] == pytest.approx(-0.9322, abs=5e-5)
    assert report["warnings"] == ["driver 'board' is not installed: its latency is not known and is taken as 0"]
    monkeypatch.setattr(
        "drivers.registry.installed_drivers", lambda: {"board": EntryPoint("board", SLOW, "hapticd.drivers")}
    )
    late = simulate(absent, 60.0, deflection=2.3)
    assert late["outcome"] == "growing"
    assert not any("latency" in warning for warning in late["warnings"])
