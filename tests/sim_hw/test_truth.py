"""What the board does to the shaft, and what its log says of it: exact motion, watchdog's instant, hand, wrap, end."""

import signal
import time
from pathlib import Path

import numpy as np
import pytest

from hapticd.config import load_config, parse_yaml
from hapticd.plant import kernel
from sim_hw.log import ROW, LogWriter, read_log
from tests import forked
from tests.polling import PATIENCE_S
from tests.sim_hw.boards import ROOT, rows, running_board
from tests.sim_hw.host import MIDDLE, Host

PLANT = """
plant: {inertia: 8.0e-6, viscous: 2.0e-5, coulomb: 1.0e-3}
encoder: {counts_per_rev: 4096}
amplifier: {dac_bits: 12, dac_full_scale: 4.0, peak_current: 3.0, bandwidth_hz: 500}
"""


def test_motion_is_the_exact_plants(tmp_path: Path) -> None:
    """The commands of the log, put into a plant of the test's own, give the log's positions to the bit."""
    script = "{hand: [{at_s: 0.01, force: 0.004, from: enabled}, {at_s: 0.03, force: -0.002, from: enabled}]}"
    with running_board(tmp_path, script, PLANT) as board:
        host = Host(board.link)
        host.begin(10_000)
        for tick in range(60):
            host.sample()
            host.command(2048 + (tick * 37) % 901 - 450, 1)
            time.sleep(0.001)
        host.sample()
        host.command(4095, 1)
        time.sleep(0.02)
        host.sample()
        host.close()
        log = board.stop()
    config = parse_yaml(PLANT, "plant")
    f = kernel.init_plant(config)
    i = f.view(np.int64)
    assert f[kernel.DAC_STEP] == 4.0 / 2048  # the board's codes lie on this plant's grid of currents
    i[kernel.TIME_NS] = log["time_ns"][0]
    compared = 0
    for row in log:
        kernel.plant_advance(f, i, row["time_ns"], 0.0)
        if row["event"] == 8:
            f[kernel.HAND_FORCE] = (0.004, -0.002)[row["code"]]
        elif row["event"] == 2 and row["detail"] >> 8 == 1:
            assert row["command_A"] == (row["code"] - 2048) * 4.0 / 2048
            kernel.plant_command(f, i, row["time_ns"], 0.0, row["command_A"])
        elif row["event"] == 1:
            assert row["position"] == pytest.approx(f[kernel.POSITION], rel=1e-9, abs=1e-12)
            assert row["velocity"] == pytest.approx(f[kernel.VELOCITY], rel=1e-9, abs=1e-9)
            assert row["counts"] == np.floor(row["position"] / config.raw_resolution)
            compared += 1
    assert compared == 62
    assert np.abs(log["position"]).max() > 10 * config.raw_resolution
    assert rows(log, "HAND").size == 2
    enabled = rows(log, "ENABLE")["time_ns"][0]
    assert (rows(log, "HAND")["time_ns"] - enabled).tolist() == [10_000_000, 30_000_000]
    assert rows(log, "APPLIED")["applied_A"].max() == 3.0  # of 4 A commanded


@pytest.mark.parametrize("watchdog_ms", [5, 20])
def test_watchdog_acts_at_its_time(tmp_path: Path, watchdog_ms: int) -> None:
    with running_board(tmp_path) as board:
        host = Host(board.link)
        host.begin(watchdog_ms)
        host.sample()
        host.command(MIDDLE + 1000, 1)
        board.wait_for_event("WATCHDOG")
        host.close()
        log = board.stop()
    accepted = rows(log, "COMMAND")["time_ns"][-1]
    trip, off = rows(log, "WATCHDOG")[0], rows(log, "DISABLE")[0]
    assert trip["time_ns"] == off["time_ns"] == accepted + watchdog_ms * 1_000_000
    assert off["command_A"] == 0.0
    reached, gone = rows(log, "APPLIED")
    assert reached["applied_A"] == pytest.approx(1000 * 6.0 / 8192, rel=1e-12)
    assert gone["applied_A"] == 0.0
    lag_ns = load_config(None).amplifier.delay * 1e9
    assert gone["time_ns"] - off["time_ns"] == pytest.approx(lag_ns, abs=1.0)


def test_counter_wraps(tmp_path: Path) -> None:
    script = "{start: {position: 0.0, counts_offset: 4294967290}, hand: [{at_s: 0.0, force: 0.05, from: enabled}]}"
    with running_board(tmp_path, script) as board:
        host = Host(board.link)
        host.begin(10_000)
        counts = [host.sample().count]
        host.command(MIDDLE, 1)
        while counts[-1] >= 4294967290 and len(counts) < 10_000:
            counts.append(host.sample().count)
        host.close()
        log = board.stop()
    assert counts[0] == 4294967290
    assert counts[-1] < 1000
    assert log["counts"][0] == 4294967290
    assert rows(log, "SAMPLE")["counts"][-1] == counts[-1] + 2**32


def test_counter_of_16_bits(tmp_path: Path) -> None:
    with running_board(tmp_path, "{start: {counts_offset: -1}}", "", "--counter-bits", "16") as board:
        host = Host(board.link)
        assert host.hello().counter_bits == 16
        assert host.sample().count == 0xFFFF
        host.close()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_with_a_complete_log(tmp_path: Path, number: int) -> None:
    with running_board(tmp_path) as board:
        assert board.ready["ready"] is True
        assert board.ready["device"] == "serial"
        assert board.ready["pid"] == board.process.pid
        assert board.link.is_symlink()
        host = Host(board.link)
        host.begin(500)
        host.sample()
        host.command(MIDDLE + 500, 1)
        log = board.stop(number)
        host.close()
    assert not board.link.is_symlink()
    assert log["event"][0] == 0
    assert log["event"][-1] == 12
    assert log["applied_A"][-1] == 0.0
    assert (np.diff(log["time_ns"]) >= 0).all()


def test_emulated_line_takes_its_time(tmp_path: Path) -> None:
    with running_board(tmp_path, "", "", "--line-baud", "19200") as board:
        host = Host(board.link)
        host.begin(500)
        before = time.monotonic_ns()
        for _ in range(5):
            host.sample()
        elapsed = time.monotonic_ns() - before
        host.close()
        log = board.stop()
    wire_ns = 10e9 / 19200 * 22
    assert elapsed >= 5 * wire_ns
    assert (np.diff(rows(log, "SAMPLE")["time_ns"]) >= wire_ns).all()


def _refused(*arguments: str) -> tuple[int, str]:
    process = forked.device(arguments, ROOT)
    _, said = process.communicate(PATIENCE_S)
    assert "Traceback" not in said
    assert process.returncode is not None
    return process.returncode, said.strip()


def test_what_it_refuses(tmp_path: Path) -> None:
    link = str(tmp_path / "board")
    file = tmp_path / "file"
    file.write_text("{plant: {inertai: 1}}")
    code, text = _refused("serial", "--link", link, "--plant", str(file))
    assert (code, "did you mean plant.inertia?" in text) == (2, True)
    code, text = _refused("serial", "--link", str(file))
    assert (code, "not a link that may be replaced" in text) == (4, True)
    file.write_text("{amplifier: {dac_bits: 18}}")
    code, text = _refused("serial", "--link", link, "--plant", str(file))
    assert (code, "amplifier.dac_bits = 18: the board's converter has 8 to 16 bits" in text) == (2, True)
    assert _refused("seriell")[0] == 2
    assert not Path(link).is_symlink()


def test_a_log_that_has_just_been_begun_reads_as_empty(tmp_path: Path) -> None:
    writer = LogWriter(tmp_path / "truth.arrow", {"device": "serial"})
    assert read_log(tmp_path / "truth.arrow").size == 0
    writer.write(np.zeros(3, ROW))
    assert read_log(tmp_path / "truth.arrow").size == 3
    writer.close()
