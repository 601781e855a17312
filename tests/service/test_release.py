"""Fig. 8 in real time: `release` against a running daemon gives the four outcomes of the paper.

A missed period is another experiment, so a run that met one is repeated; the machine, not the outcome, decides that.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.record import read_run
from hapticd.record.schema import FLAG_RUNNING
from hapticd.servo.simulate import simulate
from tests.polling import wait_until
from tests.service.daemons import daemon_on, state_home, undisturbed
from tests.servo.scripted import config

__all__ = ["state_home"]

pytestmark = pytest.mark.realtime

CASES = {
    "a": (1000, 217, 20.3, 1.2, "decaying"),
    "b": (1000, 2172, 3.3, 3.0, "persistent"),
    "c": (100, 217, 2.3, 1.0, "decaying"),
    "d": (100, 217, 10.3, 3.0, "growing"),
}


def sections(rate: int, decimation: int) -> dict[str, Any]:
    return {"servo": {"rate_hz": rate}, "encoder": {"decimation": decimation}}


@pytest.mark.parametrize("case", CASES)
def test_fig_8_in_real_time(case: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    rate, decimation, deflection, duration, outcome = CASES[case]

    def release() -> tuple[float, dict[str, Any], dict[str, Any]]:
        with daemon_on(monkeypatch, tmp_path, **sections(rate, decimation)) as (daemon, _devices):
            achieved = daemon.release(deflection, duration, force=True)["achieved_deflection"]
            wait_until(lambda: daemon.experiment()["state"] != "running", "the end of the release")
            found = achieved, daemon.experiment()["result"], daemon.status()
            if case == "d":
                daemon.clear()
            return found

    achieved, result, status = undisturbed(release, lambda found: found[2]["timing"]["missed"])
    assert achieved == pytest.approx(deflection, abs=0.5 / decimation)
    assert result["outcome"] == outcome
    if case == "d":
        assert result["fault"] in {"over_speed", "excursion"}
        assert status["current"] == 0.0
        return
    if case == "b":
        assert 4 <= result["oscillation"]["peak_to_peak_counts"] < decimation
        return
    run = read_run(Path(result["run"]))
    running = run.columns["flags"] & FLAG_RUNNING != 0
    measured = run.columns["encoder_counts"][running] - run.metadata["origin_counts"]
    rows: list[Any] = []
    simulate(
        config(**sections(rate, decimation)), 1.0, deflection=achieved, on_rows=lambda block: rows.append(block.copy())
    )
    exact = np.concatenate(rows)["encoder_counts"]
    first_swing = slice(0, int(0.07 * rate))
    assert measured[first_swing] == pytest.approx(exact[first_swing], abs=0.02 * deflection * decimation)
    assert result["final"]["position_ticks"] == pytest.approx(exact[-1] / decimation, abs=0.4)
