"""Commands that need no daemon: run, simulate, config, export, drivers."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from hapticd.record import read_run
from hapticd.record.schema import ROW

from .conftest import Run

REPORT = {
    "ticks": 1000,
    "wall_s": 0.001,
    "ticks_per_s": 1e6,
    "warnings": [],
    "fault": None,
    "outcome": "decaying",
    "peak_current_A": 1.402,
    "final": {
        "position_ticks": -0.7251,
        "velocity_ticks_per_period": float("nan"),
        "position": -0.1207,
        "velocity": 0.0,
    },
    "motion": {"peak_deflection": 3.379, "peak_velocity": 139.8, "time_to_rest_s": 0.697, "frequency_hz": 6.981},
}


@dataclass
class Simulator:
    """Stands in for ``hapticd.servo.simulate.simulate``."""

    report: dict[str, Any] = field(default_factory=lambda: REPORT)
    asked: dict[str, Any] = field(default_factory=dict)
    fails_with: BaseException | None = None
    during: Callable[[], None] = lambda: None

    def simulate(
        self,
        config: Any,
        duration_s: float,
        *,
        on_rows: Callable[[Any], None] | None,
        progress: Callable[[float], None],
        **options: Any,
    ) -> dict[str, Any]:
        self.asked = {"rate_hz": config.servo.rate_hz, "duration_s": duration_s, **options}
        if on_rows is not None:
            on_rows(np.zeros(10, dtype=ROW))
        progress(0.5)
        self.during()
        if self.fails_with is not None:
            raise self.fails_with
        return dict(self.report)


@pytest.fixture
def simulator(monkeypatch: pytest.MonkeyPatch) -> Simulator:
    simulator = Simulator()
    module = ModuleType("hapticd.servo.simulate")
    module.simulate = simulator.simulate  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "hapticd.servo.simulate", module)
    return simulator


def test_simulate_passes_its_options_on(hapticd: Run, simulator: Simulator) -> None:
    words = ("--duration", "2", "--deflection", "-20.3", "--safety", "--seed", "7", "--set", "servo.rate_hz=500")
    outcome = hapticd("simulate", *words)
    assert outcome.code == 0
    assert simulator.asked == {
        "rate_hz": 500,
        "duration_s": 2.0,
        "deflection": -20.3,
        "velocity": None,
        "safety": True,
        "seed": 7,
        "energies": True,
        "replay": None,
    }
    assert outcome.out.splitlines()[:2] == [
        "outcome   decaying, at rest after 0.697 s",
        "final     -0.7251 ticks (-0.1207 rad), - ticks/period (0 rad/s)",
    ]


def test_simulate_without_energies(hapticd: Run, simulator: Simulator) -> None:
    assert hapticd("simulate", "--duration", "2", "--no-energies").code == 0
    assert simulator.asked["energies"] is False


def test_simulate_needs_a_whole_period(hapticd: Run, simulator: Simulator) -> None:
    outcome = hapticd("simulate", "--duration", "0.0001")
    message = "hapticd: --duration 0.0001 s is shorter than one servo period (0.001 s)\n"
    assert (outcome.code, outcome.err, simulator.asked) == (2, message, {})


def test_simulate_refuses_more_time_than_it_can_count(hapticd: Run, simulator: Simulator) -> None:
    outcome = hapticd("simulate", "--duration", "1e12")
    message = "hapticd: --duration 1e+12 s is too long: the loop counts nanoseconds in 64 bits, at most 9.2e+09 s\n"
    assert (outcome.code, outcome.err, simulator.asked) == (2, message, {})


def test_simulate_says_beforehand_that_it_takes_hours(hapticd: Run, simulator: Simulator) -> None:
    outcome = hapticd("simulate", "--duration", "3.6e8", "--json")
    assert (outcome.code, simulator.asked["duration_s"]) == (0, 3.6e8)
    assert "3.6e+11 ticks: at some 10 million a second this takes 10 hours" in outcome.err
    assert hapticd("simulate", "--duration", "3600").err == ""
    assert hapticd("simulate", "--duration", "3.6e8", "--quiet").err == ""


def test_quiet_keeps_warnings_and_errors(hapticd: Run, simulator: Simulator) -> None:
    simulator.report = {**REPORT, "warnings": ["much current"]}
    assert hapticd("simulate", "--duration", "1", "-q").err == "hapticd: warning: much current\n"
    refused = hapticd("simulate", "--duration", "1e-9", "-q")
    assert (refused.code, "shorter than one servo period" in refused.err) == (2, True)


@pytest.mark.parametrize("suffix", ["csv", "parquet", "mat", "mcap", "CSV"])
def test_simulate_does_not_write_arrow_under_another_name(
    hapticd: Run, simulator: Simulator, tmp_path: Path, suffix: str
) -> None:
    out, run = tmp_path / f"out.{suffix}", tmp_path / "out.arrow"
    outcome = hapticd("simulate", "--duration", "1", "-o", str(out))
    assert (outcome.code, simulator.asked, list(tmp_path.iterdir())) == (2, {}, [])
    assert f"write {run}, then 'hapticd export {run} --to {suffix.lower()}'" in outcome.err


def test_a_decimal_comma_is_named(hapticd: Run) -> None:
    outcome = hapticd("check", "--deflection", "0,5")
    assert (outcome.code, "'0,5' is not a number; the decimal sign is a point: 0.5" in outcome.err) == (2, True)
    outcome = hapticd("check", "--set", "spring.stiffness=0,012")
    assert outcome.code == 2
    assert "must be a number in N m/rad; the decimal sign is a point: 0.012" in outcome.err


def test_simulate_json_has_no_nan(hapticd: Run, simulator: Simulator) -> None:
    outcome = hapticd("simulate", "--duration", "1", "--json")
    assert outcome.document == {**REPORT, "final": {**REPORT["final"], "velocity_ticks_per_period": None}}
    assert outcome.err == ""


def test_simulate_says_what_the_motion_was_in_si_units(hapticd: Run, simulator: Simulator) -> None:
    text = hapticd("simulate", "--duration", "1").out
    assert "decaying, at rest after 0.697 s" in text
    assert "-0.7251 ticks (-0.1207 rad)" in text
    assert "up to 3.379 rad from the origin and 139.8 rad/s; 6.981 Hz" in text
    assert "up to 1.402 A" in text
    still = {"peak_deflection": 0.1, "peak_velocity": 0.0, "time_to_rest_s": 0.0, "frequency_hz": None}
    simulator.report = {**REPORT, "outcome": "monotone", "motion": still}
    assert "monotone: it did not move, held by friction" in hapticd("simulate", "--duration", "1").out
    simulator.report = {**REPORT, "outcome": None, "motion": None}
    assert "outcome   not judged" in hapticd("simulate", "--duration", "1", "--no-energies").out


def test_simulate_writes_a_whole_run(hapticd: Run, simulator: Simulator, tmp_path: Path) -> None:
    out = tmp_path / "run.arrow"
    out.write_text("an older run")
    refused = hapticd("simulate", "--duration", "1", "-o", str(out))
    assert (refused.code, simulator.asked, out.read_text()) == (2, {}, "an older run")
    assert f"{out} exists; give another name, or --force to replace it" in refused.err
    outcome = hapticd("simulate", "--duration", "1", "--seed", "3", "-o", str(out), "--force", "--json")
    assert outcome.document["run"] == str(out)
    run = read_run(out)
    assert (len(run.columns["tick"]), run.truncated) == (10, False)
    assert run.metadata["seed"] == 3
    assert run.metadata["config"]["servo"]["rate_hz"] == 1000
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.parametrize(("failure", "code"), [(KeyboardInterrupt(), 130), (OSError(28, "No space left on device"), 2)])
def test_simulate_that_is_cut_short_leaves_no_file(
    hapticd: Run, simulator: Simulator, tmp_path: Path, failure: BaseException, code: int
) -> None:
    simulator.fails_with = failure
    assert hapticd("simulate", "--duration", "1", "-o", str(tmp_path / "run.arrow")).code == code
    assert list(tmp_path.iterdir()) == []


def test_simulate_that_is_terminated_leaves_no_file(hapticd: Run, simulator: Simulator, tmp_path: Path) -> None:
    simulator.during = lambda: os.kill(os.getpid(), signal.SIGTERM)
    with pytest.raises(SystemExit) as ending:
        hapticd("simulate", "--duration", "1", "-o", str(tmp_path / "run.arrow"))
    assert ending.value.code == 128 + signal.SIGTERM
    assert list(tmp_path.iterdir()) == []
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_progress_goes_to_a_terminal_and_never_to_stdout(
    hapticd: Run, simulator: Simulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TERM", "xterm")
    assert "simulating" not in hapticd("simulate", "--duration", "1").err
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    outcome = hapticd("simulate", "--duration", "1", "--json")
    assert outcome.document["outcome"] == "decaying"
    assert "simulating" in outcome.err


def test_simulate_into_a_missing_folder_is_a_usage_error(hapticd: Run, simulator: Simulator, tmp_path: Path) -> None:
    out = tmp_path / "none" / "run.arrow"
    outcome = hapticd("simulate", "--duration", "1", "-o", str(out))
    assert (outcome.code, outcome.err, simulator.asked) == (2, f"hapticd: {out}: there is no folder {out.parent}\n", {})


def test_run_hands_over_the_resolved_config_and_returns_its_code(hapticd: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, Any] = {}

    def run_foreground(config: Any, **options: Any) -> int:
        asked.update(options, rate_hz=config.servo.rate_hz)
        return 5

    module = ModuleType("hapticd.service.foreground")
    module.run_foreground = run_foreground  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "hapticd.service.foreground", module)
    outcome = hapticd("run", "phantom", "--start", "--set", "servo.rate_hz=250", "--socket", "/tmp/x.sock")
    assert outcome.code == 5
    assert (asked["rate_hz"], asked["source"]) == (250, "phantom")
    assert (asked["autostart"], asked["socket"]) == (True, Path("/tmp/x.sock"))


@pytest.mark.parametrize("command", [("run",), ("simulate", "--duration", "1"), ("config", "show")])
def test_wrong_config_exits_2_with_the_whole_text(hapticd: Run, tmp_path: Path, command: tuple[str, ...]) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text("servo: {rate: 500}\nspring: {stiffness: -1}\n")
    outcome = hapticd(*command, str(path))
    assert (outcome.code, outcome.out) == (2, "")
    assert "servo.rate" in outcome.err
    assert "spring.stiffness" in outcome.err
    assert str(path) in outcome.err


def test_config_error_in_json_lists_the_problems(hapticd: Run) -> None:
    outcome = hapticd("config", "show", "--set", "servo.rate_hz=fast", "--json")
    assert (outcome.code, outcome.document["error"]["code"]) == (2, "config")
    assert outcome.document["error"]["problems"][0]["key"] == "servo.rate_hz"


def test_config_show_prints_a_config_that_reads_back_the_same(hapticd: Run, tmp_path: Path) -> None:
    shown = hapticd("config", "show", "phantom", "--set", "servo.rate_hz=500")
    (tmp_path / "again.yaml").write_text(shown.out)
    again = hapticd("config", "show", str(tmp_path / "again.yaml"), "--json")
    assert again.document == hapticd("config", "show", "phantom", "--set", "servo.rate_hz=500", "--json").document
    assert again.document["servo"]["rate_hz"] == 500


def test_config_schema_is_one_document(hapticd: Run) -> None:
    assert "servo" in hapticd("config", "schema", "--json").document["properties"]
    assert hapticd("config", "schema").out == hapticd("config", "schema", "--json").out


def test_drivers_are_listed(hapticd: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    from drivers import DriverInfo

    found = [
        DriverInfo("board", "lab.board:Board (lab)", "a board", 2e-4),
        DriverInfo("broken", "lab.broken:Broken (lab)", "", 0.0, "ImportError: no module named x"),
    ]
    monkeypatch.setattr("drivers.discover", lambda: found)
    assert hapticd("drivers", "--json").document == {"drivers": [vars(info) for info in found]}
    text = hapticd("drivers").out
    assert "latency 200 us" in text
    assert "cannot be loaded: ImportError: no module named x" in text


@pytest.fixture
def recorded(hapticd: Run, simulator: Simulator, tmp_path: Path) -> Path:
    assert hapticd("simulate", "--duration", "1", "-o", str(tmp_path / "run.arrow")).code == 0
    return tmp_path / "run.arrow"


@pytest.mark.parametrize("to", ["csv", "parquet", "mat"])
def test_export_writes_beside_the_run(hapticd: Run, recorded: Path, to: str) -> None:
    outcome = hapticd("export", str(recorded), "--to", to, "--json")
    written = recorded.with_suffix(f".{to}")
    assert outcome.document == {
        "run": str(recorded),
        "output": str(written),
        "format": to,
        "rows": 10,
        "truncated": False,
    }
    assert written.stat().st_size > 0


def test_export_replaces_only_when_told(hapticd: Run, recorded: Path, tmp_path: Path) -> None:
    out = tmp_path / "wall.csv"
    out.write_text("precious")
    refused = hapticd("export", str(recorded), "--to", "csv", "-o", str(out))
    assert (refused.code, out.read_text()) == (2, "precious")
    assert refused.err == f"hapticd: {out} exists; give another name, or --force to replace it\n"
    assert hapticd("export", str(recorded), "--to", "csv", "-o", str(out), "--force").code == 0
    assert out.read_text().splitlines()[0].endswith(',"hapticd"')


def test_export_never_replaces_the_run_itself(hapticd: Run, recorded: Path) -> None:
    outcome = hapticd("export", str(recorded), "--to", "csv", "-o", str(recorded), "--force")
    assert (outcome.code, outcome.err) == (
        2,
        f"hapticd: {recorded} is the file that is read; give another name\n",
    )
    assert not read_run(recorded).truncated


def test_export_of_a_run_cut_short_warns(hapticd: Run, recorded: Path) -> None:
    recorded.write_bytes(recorded.read_bytes()[:-8])
    outcome = hapticd("export", str(recorded), "--to", "csv", "--json")
    assert (outcome.code, outcome.document["truncated"]) == (0, True)
    assert "cut short" in outcome.err


@pytest.mark.parametrize("content", [None, b"", b"not a run"])
def test_export_of_no_run_is_a_usage_error(hapticd: Run, tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "bad.arrow"
    if content is not None:
        path.write_bytes(content)
    outcome = hapticd("export", str(path), "--to", "csv")
    assert outcome.code == 2
    assert str(path) in outcome.err
    assert not path.with_suffix(".csv").exists()
