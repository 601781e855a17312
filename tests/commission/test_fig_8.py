"""Fig. 8 on the loopback, beside simulations of what the config leaves possible, at the ticks of the recording."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.commission import rig_of
from drivers import declared_latency
from hapticd.commission.model import fig_8
from hapticd.commission.rig import Rig
from hapticd.commission.step import Result
from hapticd.config import Config, apply_settings, config_to_yaml, parse_config
from hapticd.hil.cases import FIG_8, Case
from hapticd.hil.compare import LOG2_DRAWS, possible, recorded_times
from hapticd.hil.daemon import DaemonProcess
from hapticd.hil.suite import CaseResult, Released, judged
from hapticd.record import Run, RunWriter, run_metadata
from hapticd.record.schema import FLAG_MISSED_PERIOD
from hapticd.service.jobs import release_result
from hapticd.servo.simulate import simulate

UNCERTAIN = {
    "plant.uncertainty.inertia": 4e-7,
    "plant.uncertainty.viscous": 2e-6,
    "plant.uncertainty.coulomb": 2e-4,
    "plant.uncertainty.delay_s": 2e-5,
}


def config(**plant: float) -> Config:
    return apply_settings(
        parse_config({}, "RE35"), {**UNCERTAIN, **{f"plant.{key}": each for key, each in plant.items()}}
    )


def found(real: Config, folder: Path) -> tuple[Result, float]:
    """The step with a model that was identified as the RE35, on another device; and rig time, s."""
    with rig_of(config(), real, {}, folder, virtual=False) as rig:
        rig.identified.write_text(config_to_yaml(rig.config))
        return fig_8(rig), rig.seconds


@pytest.mark.realtime
@pytest.mark.usefixtures("forked")
def test_a_good_rig_is_as_simulated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is one that the uncertainty leaves possible. Simulating is not rig time: the device is at rest."""
    in_use: list[bool] = []
    held = Rig.daemon

    @contextlib.contextmanager
    def daemon(rig: Rig, model: Config | None = None) -> Iterator[DaemonProcess]:
        with held(rig, model) as running:
            in_use.append(True)
            yield running
        in_use.append(False)

    def looks(released: Released) -> CaseResult:
        assert in_use == [True, False]
        return judged(released)

    monkeypatch.setattr(Rig, "daemon", daemon)
    monkeypatch.setattr("hapticd.commission.model.judged", looks)
    result, seconds = found(config(coulomb=1.85e-3, inertia=6.5e-6), tmp_path)
    assert result.result == "pass", result.finding
    assert seconds > sum(case.duration_s for case in FIG_8[:3])


@pytest.mark.realtime
@pytest.mark.usefixtures("forked")
@pytest.mark.parametrize("factor", [0.4, 2.5])
def test_another_friction_than_the_configs_is_found(factor: float, tmp_path: Path) -> None:
    result, _ = found(config(coulomb=factor * 2e-3), tmp_path)
    assert result.result == "fail", result.finding


def released(model: Config, device: Config, case: Case, path: Path) -> Released:
    """A release that was recorded in virtual time, with missed and late ticks, and for some periods longer than it lasts."""
    model, device = (apply_settings(each, case.settings, source=case.name) for each in (model, device))
    ticks = np.delete(np.arange(round(case.duration_s * case.rate_hz) + 25), [5, 9, 10, 14, 15, 16, 40, 41])
    times = np.stack([ticks, np.where(ticks % 3, 0, 150_000)]).astype(np.int64)
    blocks: list[Any] = []
    report = simulate(
        device, 1.0, deflection=case.deflection, replay=times, on_rows=lambda rows: blocks.append(rows.copy())
    )
    metadata = run_metadata(model.model_dump(mode="json"), origin_counts=model.origin_counts)
    with RunWriter(path, metadata) as writer:
        for rows in blocks:
            writer.write(rows)
    # as the daemon reads it: the shaft stands somewhere within its count
    achieved = np.floor(case.deflection * case.decimation) / case.decimation
    result = {
        "achieved_deflection": achieved,
        "fault": report["fault"] and report["fault"]["code"],
        "run": str(path),
        **release_result(path, case.decimation, model.origin_counts, 0),
    }
    return Released(case, model, result, {"attempts": 1, "disturbances": 0})


def test_a_release_is_simulated_at_its_own_ticks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = FIG_8[0]
    model = config()
    done = released(model, model, case, tmp_path / "run.arrow")
    found = judged(done)
    assert found.problems == ()
    assert found.comparison.current_rms_error < 1e-9
    monkeypatch.setattr("hapticd.hil.suite.recorded_times", lambda run, count: None)
    assert judged(done).problems != ()


def test_an_uncertain_plant_is_not_called_wrong(tmp_path: Path) -> None:
    """What one plant explains is an agreement; the same recording, and a config that is sure of another, is none."""
    case = FIG_8[0]
    device = apply_settings(config(), {"plant.inertia": 7.2e-6}, source="the device")
    unsure = apply_settings(config(), {"plant.uncertainty.inertia": 8e-7}, source="unsure")
    sure = apply_settings(config(), dict.fromkeys(UNCERTAIN, 0.0), source="sure")
    problems = {
        name: judged(released(model, device, case, tmp_path / f"{name}.arrow")).problems
        for name, model in (("unsure", unsure), ("sure", sure))
    }
    assert problems["unsure"] == ()
    assert problems["sure"] != ()


@pytest.mark.parametrize("within", [0.02, 0.34, 0.66, 0.98])
def test_where_the_shaft_stands_within_its_count_is_not_known(within: float, tmp_path: Path) -> None:
    """Case c turns on it: a count sooner over the edge of a tick, another current follows."""
    case = next(case for case in FIG_8 if case.name == "c")
    counts = np.floor(case.deflection * case.decimation)
    moved = replace(case, deflection=(counts + within) / case.decimation)
    found = judged(released(config(), config(), moved, tmp_path / "run.arrow"))
    assert found.problems == ()
    assert found.report["achieved_deflection"] == counts / case.decimation


def test_a_motion_that_the_release_s_time_cuts_off_is_compared_up_to_there(tmp_path: Path) -> None:
    """A lighter friction and a larger inertia than the paper's: after case a's time the shaft still swings."""
    case = FIG_8[0]
    rig = apply_settings(config(inertia=8.75e-6, viscous=7.3e-6, coulomb=1.05e-3), dict.fromkeys(UNCERTAIN, 0.0))
    done = released(rig, rig, case, tmp_path / "run.arrow")
    assert done.result["rest"] is None
    found = judged(done)
    assert found.problems == ()
    assert "rest_torque" not in found.report


def test_what_a_release_may_have_been() -> None:
    sure = parse_config({}, "RE35")
    assert all(plant == sure for plant, _ in possible(sure))
    starts = np.sort([start * sure.encoder.decimation for _, start in possible(sure)])
    assert starts[0] > 0.0
    assert starts[-1] < 1.0
    assert np.diff(starts).max() < 3.0 / len(starts)
    correlated = apply_settings(config(), {"plant.uncertainty.correlation.inertia_coulomb": 0.99}, source="test")
    (own, middle), *drawn = possible(correlated)
    assert own == correlated
    assert middle == 0.5 / correlated.encoder.decimation
    assert len(drawn) == 2**LOG2_DRAWS
    assert drawn == possible(correlated)[1:]
    inertia, coulomb = (np.log([getattr(each.plant, name) for each, _ in drawn]) for name in ("inertia", "coulomb"))
    assert np.corrcoef(inertia, coulomb)[0, 1] > 0.9
    assert 0.5 < inertia.std() / (4e-7 / 6.28e-6) < 1.6
    assert np.std([declared_latency(each)[0] for each, _ in drawn]) < 6e-5


def test_a_recording_that_ended_early_goes_on_on_the_grid() -> None:
    columns = {
        "tick": np.array([7, 8, 10]),
        "wake_late_ns": np.array([5, -1, 9]),
        "flags": np.array([1, 1, 1 | FLAG_MISSED_PERIOD]),
    }
    run = Run(Path("run.arrow"), columns)
    assert recorded_times(run).tolist() == [[7, 8, 10], [5, 0, 9]]
    assert recorded_times(run, 6).tolist() == [[7, 8, 10, 11, 12], [5, 0, 9, 0, 0]]
    assert recorded_times(run, 2).tolist() == [[7, 8], [5, 0]]


def test_a_shaft_that_rests_where_its_friction_would_not_hold_it(tmp_path: Path) -> None:
    """Anywhere in the band of friction is right, for that depends on the last swings; beyond it is not."""
    case = FIG_8[0]
    for factor, is_right in ((1.1, True), (4.0, False)):
        device = config(coulomb=factor * config().plant.coulomb)
        problems = judged(released(config(), device, case, tmp_path / f"{factor}.arrow")).problems
        assert any("does not hold the shaft at both" in problem for problem in problems) != is_right, problems
