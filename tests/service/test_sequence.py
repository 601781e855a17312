"""A list of settings, one release each, as one experiment: recorded step by step, and ended by any stop or fault."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest

from hapticd.config import ConfigError
from hapticd.record import read_run
from hapticd.record.listing import listed
from hapticd.record.where import choose, read_condition
from hapticd.service.daemon import Daemon
from hapticd.service.refusals import Refused
from tests.polling import wait_until
from tests.service.daemons import daemon_on, state_home, wait_for_state

__all__ = ["state_home"]

STEPS: list[dict[str, Any]] = [
    {"deflection": 712.0, "duration_s": 0.5, "settings": {"spring.stiffness": 0.008}},
    {"deflection": 9.0, "duration_s": 0.5, "settings": {"spring.stiffness": 0.012, "encoder.decimation": 2}},
    {"deflection": -6.0, "duration_s": 0.5},
]


def ended(daemon: Daemon) -> dict[str, Any]:
    wait_until(lambda: daemon.experiment()["state"] != "running", "the end of the sequence", 60)
    return daemon.experiment()


def test_one_release_each_one_experiment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path, safety={"guard": "warn"}) as (daemon, _):
        before = daemon.config()
        job = daemon.sequence(STEPS, "stiffness")
        assert (job["steps"], job["sequence"]) == (3, "stiffness")
        with pytest.raises(Refused) as busy:
            daemon.set({"spring.stiffness": 0.02})
        assert busy.value.code == "busy"
        report = ended(daemon)
        assert (report["id"], report["state"], report["progress"]) == (job["experiment"], "done", 1.0)
        assert (report["step"], report["steps"]) == (3, 3)
        assert daemon.status()["state"] == "off"
        assert daemon.config() == before
        found = [Path(run["run"]) for run in report["result"]["runs"]]
        assert found[0] == Path(job["run"])
        assert [run["outcome"] for run in report["result"]["runs"]] == ["decaying"] * 3
        assert choose([listed(path) for path in found], [read_condition("sequence=stiffness")])
        for number, (path, step) in enumerate(zip(found, STEPS, strict=True), 1):
            run = read_run(path)
            said = run.metadata["sequence"]
            assert (said["step"], said["steps"], said["name"]) == (number, 3, "stiffness")
            settings = step.get("settings", {})
            assert run.metadata["config"]["spring"]["stiffness"] == settings.get("spring.stiffness", 0.012)
            decimation = settings.get("encoder.decimation", 1)
            assert run.metadata["config"]["encoder"]["decimation"] == decimation
            started = run.columns["encoder_counts"][0] - run.metadata["origin_counts"]
            assert started / decimation == pytest.approx(step["deflection"])
        # nothing of it is in the next recording
        daemon.release(3, 0.3)
        assert "sequence" not in read_run(Path(ended(daemon)["result"]["run"])).metadata


@pytest.mark.parametrize("how", ["stop", "estop", "stop while it waits"])
def test_a_stop_ends_all_of_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, how: str) -> None:
    with daemon_on(monkeypatch, tmp_path) as (daemon, _):
        before = daemon.config()
        daemon.sequence([{**step, "duration_s": 0.4} for step in STEPS])
        if how == "stop while it waits":  # between two steps the loop is off, and waits for a shaft at rest
            wait_until(lambda: len(daemon.experiment()["result"]["runs"]) == 1, "the first release", 30)
        else:
            time.sleep(0.1)
        daemon.estop() if how == "estop" else daemon.stop()
        report = ended(daemon)
        assert report["state"] == ("done" if report["result"].get("fault") else "aborted")
        assert len(report["result"]["runs"]) < 3
        made = len(list((tmp_path / "runs").glob("*sequence*")))
        time.sleep(1.0)
        assert daemon.status()["state"] == ("fault" if how == "estop" else "off")
        assert len(list((tmp_path / "runs").glob("*sequence*"))) == made
        assert daemon.config() == before


def test_a_fault_ends_all_of_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path) as (daemon, _):
        before = daemon.config()
        slow = {"deflection": 700.0, "duration_s": 0.5, "settings": {"safety.max_velocity": 0.05}}
        daemon.sequence([STEPS[0], slow, STEPS[0]], force=True)
        assert wait_for_state(daemon, "fault")["fault"]["code"] == "over_speed"
        report = ended(daemon)
        assert report["result"]["fault"] == "over_speed"
        assert len(report["result"]["runs"]) == 2
        assert daemon.config() == before


@pytest.mark.parametrize(
    ("step", "error", "said"),
    [
        ({"deflection": 3.0, "settings": {"spring.stiffness": -1}}, ConfigError, "spring.stiffness"),
        ({"deflection": 3.0, "settings": {"amplifier.dac_bits": 8}}, Refused, "step 2: amplifier.dac_bits"),
        ({"deflection": 3.0, "settings": {"spring.origin": 1}}, Refused, "step 2: spring.origin: a release moves it"),
        ({"deflection": 1e8}, Refused, "step 2: a deflection of"),
        ({"deflection": 500.0, "settings": {"encoder.decimation": 217, "spring.stiffness": 5}}, Refused, "step 2"),
    ],
)
def test_all_is_judged_before_anything_moves(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, step: dict[str, Any], error: type[Exception], said: str
) -> None:
    with daemon_on(monkeypatch, tmp_path, safety={"guard": "refuse"}) as (daemon, _):
        before = daemon.config()
        with pytest.raises(error) as refused:
            daemon.sequence([STEPS[0], step])
        assert said in str(refused.value)
        assert daemon.experiment()["id"] == 0
        assert daemon.config() == before
        assert not list((tmp_path / "runs").glob("*"))
