"""The bench around an emulated board: what it refuses, and that nothing of it stays behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from sim_hw.log import read_log
from tests.firmware.builds import require
from tests.firmware.devices import Device
from tests.polling import wait_until
from tests.sim_hw.boards import ROOT, rows
from tests.sim_hw.host import Host


def refused(*arguments: str) -> tuple[int, str]:
    command = [sys.executable, "-m", "sim_hw", "firmware", "--board", "host", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=250, check=False)
    assert "Traceback" not in done.stderr
    return done.returncode, done.stderr.strip()


def test_what_it_refuses(tmp_path: Path) -> None:
    require("host")
    link = ("--link", str(tmp_path / "board"))
    code, text = refused(*link, "--image", str(tmp_path / "none"))
    assert (code, "is missing: 'make firmware'" in text) == (4, True)
    plant = tmp_path / "plant.yaml"
    plant.write_text("{amplifier: {dac_bits: 16, dac_full_scale: 5.0}}")
    code, text = refused(*link, "--plant", str(plant))
    assert (code, "amplifier.dac_bits = 16: this board has 14 bits" in text) == (2, True)
    assert not (tmp_path / "board").is_symlink()


def _children(pid: int) -> list[int]:
    text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    return [int(word) for word in text.split()]


def _gone(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


@pytest.mark.parametrize("board", ["host", "mps2-an385"])
def test_a_board_ends_with_its_bench(board: str, tmp_path: Path) -> None:
    require(board)
    for number in (signal.SIGTERM, signal.SIGKILL):
        folder = tmp_path / number.name
        folder.mkdir()
        with Device(board).running(folder) as running:
            host = Host(running.link)
            host.hello()
            emulators = _children(running.process.pid)
            assert len(emulators) == 1
            host.close()
            running.process.send_signal(number)
            running.process.wait(60)
        wait_until(lambda emulators=emulators: all(_gone(pid) for pid in emulators), "the emulator to end")


def test_a_board_that_ends_is_an_error(tmp_path: Path) -> None:
    require("host")
    with Device("host").running(tmp_path) as running:
        (emulator,) = _children(running.process.pid)
        os.kill(emulator, signal.SIGKILL)
        assert running.process.wait(60) == 4
        assert "the board's process has ended" in running.process.stderr.read()


@pytest.mark.parametrize("board", ["host", "mps2-an385", pytest.param("avr-uno", marks=pytest.mark.avr)])
def test_every_edge_is_counted(board: str, tmp_path: Path) -> None:
    """The shaft is pushed there and back; when it rests, the board shows what the plant's encoder shows."""
    require(board)
    script = "{hand: [{at_s: 0.1, force: 0.0022}, {at_s: 0.5, force: -0.0024}, {at_s: 0.8, force: 0.0}]}"
    with Device(board).host(tmp_path, script) as (running, host):
        hello = host.hello()
        running.wait_for_event("HAND", 3)
        counts = [host.sample().count, -1]

        def rests() -> bool:
            time.sleep(0.1)
            counts[:] = [host.sample().count, counts[0]]
            return counts[0] == counts[1]

        wait_until(rests, "the shaft to rest, and its edges to be through")
        assert host.sample().status & 4 == 0
        log = running.stop()
    shown = (counts[0] + (1 << 31)) % (1 << hello.counter_bits) - (1 << 31)
    assert shown == log["counts"][-1]
    assert abs(log["counts"]).max() > 50


def test_the_first_output_is_off_and_at_mid_scale(tmp_path: Path) -> None:
    require("host")
    with Device("host").running(tmp_path) as running:
        time.sleep(0.1)
        log = running.stop()
    first = rows(log, "COMMAND")
    assert first["code"].tolist() == [1 << 13]
    assert first["detail"][0] < 5_000_000
    assert rows(read_log(tmp_path / "truth.arrow"), "ENABLE", "DISABLE").size == 0
