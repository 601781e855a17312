"""Case d of Fig. 8, which runs away, with the passivity controller or virtual damping, in real time on each device."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from hapticd.config import apply_settings
from hapticd.hil.cases import FIG_8
from hapticd.hil.suite import run_suite
from hapticd.record import read_run
from hapticd.stability.run_energy import run_energy
from tests.hil.test_hil import TRANSPORTS
from tests.hil.test_hil import config as hil_config
from tests.polling import wait_until
from tests.service.daemons import daemon_on, state_home, undisturbed

__all__ = ["state_home"]

(CASE_D,) = [replace(case, duration_s=1.5) for case in FIG_8 if case.name == "d"]
MEANS: dict[str, dict[str, object]] = {
    "the controller": {"safety.passivity": "control"},
    "virtual damping": {"spring.damping": 4.5e-4},
}
"""Each stops the case from every deflection and delay near these. Both at once, or less damping, may leave a cycle of less
than a tick, as it comes."""


@pytest.mark.usefixtures("forked")
@pytest.mark.parametrize("means", MEANS)
@pytest.mark.parametrize("transport", ["serial board on a pty", "CAN frames over a Unix socket"])
def test_either_stops_case_d(transport: str, means: str) -> None:
    calm = apply_settings(hil_config(TRANSPORTS[transport]), MEANS[means])
    (case,) = run_suite(calm, cases=[CASE_D], with_excitation=False).cases
    if case.report["disturbances"]:
        pytest.skip(f"this machine disturbed each of {case.report['attempts']} runs: no statement")
    assert case.report["outcome"] == "decaying"
    assert case.report["simulated_outcome"] in ("decaying", "monotone")
    assert case.report["fault"] is None


def test_the_loopback_books_what_a_replay_of_its_run_books(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    sections = {"servo": {"rate_hz": 100}, "encoder": {"decimation": 217}, "safety": {"passivity": "control"}}

    def release() -> tuple[dict[str, Any], dict[str, Any]]:
        with daemon_on(monkeypatch, tmp_path, **sections) as (daemon, _devices):
            daemon.release(10.3, 1.5, force=True)
            wait_until(lambda: daemon.experiment()["state"] != "running", "the end of the release")
            metrics = daemon.metrics()
            status = daemon.status()
            assert f'hapticd_passivity_joules{{kind="dissipated"}} {status["passivity"]["dissipated_J"]}' in metrics
            return daemon.experiment()["result"], status

    result, status = undisturbed(release, lambda found: found[1]["timing"]["missed"])
    assert result["outcome"] == "decaying"
    booked = status["passivity"]
    assert booked["mode"] == "control"
    assert booked["dissipated_J"] > 0.0
    replayed = run_energy(read_run(Path(result["run"]))).report["observed_J"]
    assert replayed["put_out"] == pytest.approx(booked["put_out_J"], rel=1e-9)
    assert replayed["generated"] == pytest.approx(booked["generated_J"], rel=1e-9, abs=1e-12)
