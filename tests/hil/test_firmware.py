"""`hapticd hil --device firmware`: the emulated binary against the daemon, at a rate that it keeps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hapticd.cli.main import main
from hapticd.config import Config, parse_config
from hapticd.hil.cases import FIG_8, FIRMWARE_CONFIG, FIRMWARE_RATE_HZ, slower_case, slower_rig
from hapticd.hil.errors import HilError
from hapticd.hil.injections import INJECTIONS
from hapticd.hil.matrix import run_injection, with_current
from hapticd.hil.suite import run_suite
from hapticd.stability.numbers import loop_from_config
from tests.firmware.builds import require


def rig(watchdog_ms: int = 20) -> Config:
    document = {
        **FIRMWARE_CONFIG,
        "driver": {**FIRMWARE_CONFIG["driver"], "watchdog_ms": watchdog_ms},
        "safety": {"missed_exchanges": 10, "heartbeat_timeout_s": 10},
    }
    return parse_config(document, "test")


@pytest.mark.parametrize("case", FIG_8, ids=lambda case: case.name)
def test_the_slower_rig_is_the_papers(case: object) -> None:
    assert isinstance(case, type(FIG_8[0]))
    at_its_rate = rig().model_copy(
        update={"servo": rig().servo.model_copy(update={"rate_hz": case.rate_hz}), "driver": rig().driver}
    )
    slow = slower_rig(rig(), case.rate_hz, FIRMWARE_RATE_HZ)
    fast_numbers = loop_from_config(at_its_rate, 0.0).numbers
    slow_numbers = loop_from_config(slow, 0.0).numbers
    for name in ("mu", "beta", "sigma", "tau_d"):
        assert getattr(slow_numbers, name) == pytest.approx(getattr(fast_numbers, name), rel=1e-12)
    stretched = slower_case(case, FIRMWARE_RATE_HZ)
    assert stretched.duration_s * FIRMWARE_RATE_HZ == pytest.approx(case.duration_s * case.rate_hz)
    assert (stretched.deflection, stretched.decimation) == (case.deflection, case.decimation)


def test_a_rig_with_effects_has_no_slower_one() -> None:
    config = parse_config({"plant": {"effects": [{"name": "constant_bias", "tau_0": 1e-4}]}}, "test")
    with pytest.raises(HilError, match=r"plant\.effects: cannot be brought to another rate"):
        slower_rig(config, 1000.0, 200.0)


@pytest.mark.realtime
@pytest.mark.usefixtures("forked")
def test_case_c_stops_as_simulated(tmp_path: Path) -> None:
    require("mps2-an385")
    (case_c,) = [case for case in FIG_8 if case.name == "c"]
    result = run_suite(rig(400), cases=[case_c], board="mps2-an385", keep=tmp_path / "kept")
    (case,) = result.cases
    assert (tmp_path / "kept" / "c" / "device.arrow").exists()
    if case.report["disturbances"]:
        pytest.skip(f"this machine missed periods in each of {case.report['attempts']} runs: no statement")
    assert case.report["outcome"] == "decaying"
    assert abs(case.report["final_ticks"]) <= 1.0
    assert len(result.latency_s) > 50
    assert float(np.median(result.latency_s)) < 0.005


@pytest.mark.realtime
@pytest.mark.usefixtures("forked")
@pytest.mark.parametrize(
    ("board", "name"),
    [
        ("mps2-an385", "sigkill"),
        ("mps2-an385", "reboot"),
        ("mps2-an385", "external_stop"),
        ("host", "encoder_glitch"),
        ("host", "unplug"),
    ],
)
def test_a_fault_ends_the_current(board: str, name: str, tmp_path: Path) -> None:
    require(board)
    (injection,) = [one for one in INJECTIONS if one.name == name]
    config = slower_rig(with_current(rig(400)), 1000.0, FIRMWARE_RATE_HZ)
    try:
        row = run_injection(config, injection, tmp_path, board)
    except HilError as error:
        if "this machine is too busy" not in str(error):
            raise
        pytest.skip(str(error))
    assert row.zero_after_s is not None
    assert row.zero_after_s < 0.7
    assert row.code in injection.codes or not injection.codes


def test_what_the_command_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, said in (
        (["hil"], "CONFIG is missing"),
        (["hil", "--device", "board"], "--device board: unknown (known: simulated, firmware)"),
        (["hil", "re35", "--device", "firmware"], "the firmware is a serial board's"),
        (["hil", "--device", "firmware", "--plant", "re35"], "--plant goes with simulated devices"),
        (["hil", "--device", "firmware", "--only", "excitation"], "--only excitation: unknown"),
    ):
        assert main(arguments) == 2
        assert said in capsys.readouterr().err
