"""A daemon that is killed, and what the next one makes of what it left."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hapticd.config import Config
from hapticd.record import read_run
from hapticd.record.flight import Flight, memory_directory
from hapticd.record.schema import FLAG_DROPPED, empty_rows
from hapticd.service import flight
from hapticd.servo import atomics, faults, layout
from tests.servo.scripted import Scripted, config, core_for

MANY = (("kill", 200), ("segv", 20))
needs_memory = pytest.mark.skipif(memory_directory() is None, reason="no file system in memory here")


@needs_memory
@pytest.mark.realtime
@pytest.mark.parametrize(
    ("how", "kills"),
    [
        ("kill", 3),
        ("segv", 3),
        *(pytest.param(*many, marks=[pytest.mark.attack, pytest.mark.timeout(3600)]) for many in MANY),
    ],
)
def test_a_killed_daemon_loses_no_row_that_it_had_finished(how: str, kills: int) -> None:
    command = [sys.executable, "-m", "tests.service.kills", "--kills", str(kills), "--how", how]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["signals"] == [{"kill": "SIGKILL", "segv": "SIGSEGV"}[how]]
    assert found["rows"] > 100 * kills
    assert found["lost"] == 0


def left(mode: int, fault: int = 0, *, rebooted: bool = False) -> Flight:
    words = np.zeros(atomics.SIZE, np.int64)
    words[atomics.MODE], words[atomics.FAULT_CODE] = mode, fault
    rows = empty_rows(3)
    rows["time_s"] = [1.0, 1.5, 2.0]
    return Flight(Path("x.flight"), rows, words, {}, 7, 0, rebooted, 0)


def test_the_reason_is_told_as_far_as_anything_tells() -> None:
    assert flight.why(left(layout.RUNNING)) == (
        "killed",
        "the daemon was killed in state running, 2.000 s after its start, by SIGKILL or for want of memory",
    )
    crash = "Fatal Python error: Segmentation fault\n\nThread 0x1 (most recent call first):\n"
    code, words = flight.why(left(layout.FAULT, faults.OVER_SPEED), crash)
    assert code == "signal"
    assert words == "the daemon died in state fault with the fault over_speed of a fatal signal: Segmentation fault"
    assert flight.why(left(layout.OFF, rebooted=True))[1] == "the machine stopped or lost power in state off"


def on_a_disk(tmp_path: Path) -> Config:
    return config(record={"directory": str(tmp_path / "runs"), "flight_directory": str(tmp_path)})


def test_what_was_left_becomes_one_run_and_is_taken_away(tmp_path: Path) -> None:
    ring, grant = flight.open_ring(on_a_disk(tmp_path), "rig")
    assert ring is not None
    assert grant.granted
    assert flight.recover(tmp_path, "rig") == [], "its daemon lives"
    ring.rows["tick"][:5], ring.rows["time_s"][:5] = range(5), np.arange(5) * 1e-3
    ring.shared[atomics.RING_HEAD] = 5
    ring.shared[atomics.MODE] = layout.RUNNING
    ring.describe({"config": on_a_disk(tmp_path).model_dump(mode="json")})
    ring.leave()
    assert flight.recover(tmp_path, "another") == []
    (found,) = flight.recover(tmp_path, "rig")
    run = read_run(found.run)
    assert found.run.parent == tmp_path / "runs"
    assert found.run.name.startswith("crash-")
    assert run.columns["tick"].tolist() == [0, 1, 2, 3, 4]
    assert (run.metadata["kind"], run.metadata["label"]) == ("crash", "killed")
    assert "in state running" in run.metadata["reason"]
    assert not list(tmp_path.glob("*.flight"))


def test_what_cannot_be_recovered_is_said_and_left(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "rig-1-1.flight").write_bytes(b"x" * 9000)
    assert flight.recover(tmp_path, "rig") == []
    assert "could not be recovered" in caplog.text
    assert (tmp_path / "rig-1-1.flight").exists()


def test_the_first_row_after_a_full_ring_says_so() -> None:
    cfg = config()
    core = core_for(Scripted(cfg), cfg)
    core.run(real_time=False, ticks=1500)
    before = core.drain()
    core.run(real_time=False, ticks=10)
    after = core.drain()
    assert core.dropped() == 1500 - 1024
    assert not np.any(before["flags"] & FLAG_DROPPED)
    assert ((after["flags"] & FLAG_DROPPED) != 0).tolist() == [True] + [False] * 9
    assert after["tick"][0] - before["tick"][-1] - 1 == core.dropped()


def test_the_past_is_read_out_of_the_ring_taken_or_not() -> None:
    cfg = config()
    core = core_for(Scripted(cfg), cfg)
    assert core.history(1.0).size == 0
    core.run(real_time=False, ticks=600)
    core.drain()
    core.run(real_time=False, ticks=900)
    past = core.history(0.25)
    assert past["tick"][-1] == core.history(100.0)["tick"][-1]
    assert past.size == 250
    assert np.all(np.diff(core.history(100.0)["tick"]) == 1)
    assert core.history(100.0).size == 1023
