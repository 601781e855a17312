"""A daemon whose socket, lock or run file is taken away while it runs: it can be stopped, and says what was done."""

from __future__ import annotations

import fcntl
import os
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hapticd.record import read_run
from hapticd.record.flight import memory_directory
from hapticd.service.latch import daemon_name
from hapticd.service.socket import stop_path
from tests.polling import PATIENCE_S, wait_until
from tests.service.processes import Rig

pytestmark = pytest.mark.realtime


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    """Its socket in a folder of its own."""
    (tmp_path / "run").mkdir()
    made = Rig(tmp_path, tmp_path / "run" / "h.sock", safety={"heartbeat_timeout_s": 10})
    yield made
    for process in made.processes:
        process.close()


def found(rig: Rig, what: str) -> dict[str, Any]:
    """What the daemon has found of one thing."""
    (entry,) = (entry for entry in rig.client.status()["self_check"] if entry["what"] == what)
    return dict(entry)


@pytest.mark.parametrize("folder", [False, True])
def test_a_socket_that_is_removed_is_there_again_and_the_motor_can_be_stopped(folder: bool, rig: Rig) -> None:
    rig.launch()
    rig.render()
    if folder:
        shutil.rmtree(rig.socket.parent)
    else:
        rig.socket.unlink()
    wait_until(rig.answers, "an answer on the socket bound anew")
    entry = found(rig, "socket")
    assert entry["ok"]
    assert f"the socket {rig.socket} was removed or replaced" in entry["found"]
    assert f"bound anew at {rig.socket}" in entry["done"]
    assert rig.command("stop", "--socket", str(rig.socket)).returncode == 0
    assert rig.client.status()["state"] == "off"
    rig.processes[0].terminate()
    assert rig.processes[0].wait(PATIENCE_S) == 0
    assert not rig.socket.exists()
    assert f"the socket {rig.socket} was removed or replaced" in rig.output.read_text()


def test_no_second_daemon_starts_where_the_socket_was(rig: Rig) -> None:
    process = rig.launch()
    rig.render()
    process.send_signal(signal.SIGSTOP)  # it binds nothing anew meanwhile
    opened = len(rig.commands())
    shutil.rmtree(rig.socket.parent)
    second = rig.command("run", str(rig.config), "--socket", str(rig.socket))
    process.send_signal(signal.SIGCONT)
    assert second.returncode == 2
    assert f"another daemon (process {process.pid}) runs on {rig.socket}" in second.stderr
    assert "closed" not in rig.commands()[opened:]


def test_where_another_daemon_has_the_place_this_one_ends_and_leaves_it_alone(rig: Rig) -> None:
    """One of another state folder, which does not see the lock, and both sockets were gone when it came."""
    process = rig.launch()
    rig.render()
    process.send_signal(signal.SIGSTOP)  # it binds nothing anew meanwhile
    shutil.rmtree(rig.socket.parent)
    (rig.folder / "other").mkdir()
    other = Rig(rig.folder / "other", rig.socket)
    rig.processes.append(other.launch())
    sockets = [os.lstat(path).st_ino for path in (rig.socket, stop_path(rig.socket))]
    process.send_signal(signal.SIGCONT)
    assert process.wait(PATIENCE_S) == 2
    rig.check_end()
    assert f"another daemon answers on {rig.socket}" in rig.output.read_text()
    assert other.answers()
    assert [os.lstat(path).st_ino for path in (rig.socket, stop_path(rig.socket))] == sockets


def test_what_would_be_missed_after_a_crash_is_said(rig: Rig, tmp_path: Path) -> None:
    """The flight recorder's file is gone, and the state folder is a file."""
    rig.launch()
    memory = memory_directory()
    assert memory is not None
    for path in memory.glob(f"{daemon_name(rig.socket)}-*.flight"):
        path.unlink()
    shutil.rmtree(tmp_path / "state")
    (tmp_path / "state").write_text("in the way")
    for what in ("flight_recorder", "latch"):
        wait_until(lambda what=what: not found(rig, what)["ok"], f"it in the document: {what}")  # type: ignore[misc]
    assert "a fault would not outlive a restart" in found(rig, "latch")["found"]
    assert "was removed" in found(rig, "flight_recorder")["found"]
    shown = rig.command("status", "--socket", str(rig.socket)).stdout
    assert "attention     a fault would not outlive a restart" in shown


def test_where_the_socket_cannot_be_bound_anew_the_motor_is_switched_off(rig: Rig) -> None:
    rig.launch()
    rig.render()
    shutil.rmtree(rig.socket.parent)
    rig.socket.parent.write_text("in the way")
    wait_until(lambda: rig.commands()[-1] == "0.0 0", "zero current, amplifier off")
    wait_until(lambda: "the motor is off" in rig.output.read_text(), "the reason in the log")
    rig.socket.parent.unlink()
    wait_until(rig.answers, "an answer on the socket bound anew")
    assert rig.client.status()["state"] == "off"


def test_who_locks_the_socket_s_folder_keeps_no_daemon_from_starting_and_ending(rig: Rig) -> None:
    holder = os.open(rig.socket.parent, os.O_RDONLY)
    fcntl.flock(holder, fcntl.LOCK_EX)
    process = rig.launch()
    process.terminate()
    assert process.wait(PATIENCE_S) == 0
    os.close(holder)
    assert not rig.socket.exists()


def recorded(rig: Rig) -> dict[str, Any]:
    """The recorder's status."""
    return dict(rig.client.status()["recorder"])


@pytest.mark.parametrize("harm", ["file", "folder", "cut"])
def test_a_run_file_that_is_taken_away_is_gone_on_with(harm: str, rig: Rig) -> None:
    rig.launch()
    rig.render()
    wait_until(lambda: recorded(rig)["rows"] > 300, "recorded rows")
    path = Path(recorded(rig)["path"])
    if harm == "file":
        path.unlink()
    elif harm == "folder":
        shutil.rmtree(path.parent)
    else:
        path.write_bytes(b"")
    wait_until(lambda: recorded(rig)["continued"] is not None and recorded(rig)["rows"] > 300, "rows in a new file")
    status = recorded(rig)
    assert status["error"] is None
    assert status["path"] != str(path)
    assert status["continued"].startswith(f"{path} {'was cut' if harm == 'cut' else 'was deleted'}")
    wait_until(lambda: found(rig, "run_file")["found"] == status["continued"], "it in the document")
    rig.client.stop()
    run = read_run(Path(status["path"]))
    assert (run.truncated, run.events[0]["event"]) == (False, "continued")
    assert rig.output.read_text().count("the recording goes on in") == 1


def test_a_recording_that_cannot_go_on_says_so_and_the_spring_stays(rig: Rig) -> None:
    rig.launch()
    rig.render()
    wait_until(lambda: recorded(rig)["rows"] > 300, "recorded rows")
    runs = rig.folder / "runs"
    shutil.rmtree(runs)
    runs.write_text("in the way")
    wait_until(lambda: recorded(rig)["error"] is not None, "the error")
    assert recorded(rig)["error"].endswith(f"record.directory {runs} is not a folder")
    wait_until(lambda: not found(rig, "run_file")["ok"], "it in the document")
    shown = rig.command("status", "--socket", str(rig.socket)).stdout
    assert f"attention     {recorded(rig)['error']}; the servo loop goes on, unrecorded" in shown
    assert rig.client.status()["state"] == "running"
