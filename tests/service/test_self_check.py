"""What the daemon finds when it looks at itself, and what it does about it. Looks are called, not waited for."""

from __future__ import annotations

import logging
import os
import shutil
import threading
from collections import namedtuple
from pathlib import Path
from socket import AF_UNIX, SOCK_DGRAM, SOCK_STREAM, socket
from types import SimpleNamespace
from typing import Any

import pytest

from hapticd.record.flight import FlightRing
from hapticd.service import checks
from hapticd.service.foreground import latch_unwritable
from hapticd.service.self_check import Look, SelfCheck
from hapticd.service.socket import bind, stop_path
from tests.polling import wait_until

NEVER_S = 1e6


def entry(checked: SelfCheck, what: str) -> dict[str, Any]:
    (found,) = (entry for entry in checked.document() if entry["what"] == what)
    return found


@pytest.fixture(autouse=True)
def state_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)


@pytest.fixture
def checked() -> Any:
    made = SelfCheck(NEVER_S)
    yield made
    made.end()


def test_what_is_found_is_said_once_and_stays_in_the_document(
    checked: SelfCheck, caplog: pytest.LogCaptureFixture
) -> None:
    looks = [Look(), Look("gone", "bound anew", mended=True), Look(), Look("gone", "no room"), Look("gone", "no room")]
    checked.add("thing", lambda: looks.pop(0))
    seen = []
    for _ in range(5):
        checked.look(slow=False)
        found = entry(checked, "thing")
        seen.append((found["ok"], found["found"], found["done"]))
    assert seen == [
        (True, None, None),
        (True, "gone", "bound anew"),
        (True, "gone", "bound anew"),
        (False, "gone", "no room"),
        (False, "gone", "no room"),
    ]
    lines = [(record.levelno, record.getMessage()) for record in caplog.records]
    assert lines == [(logging.WARNING, "gone; bound anew"), (logging.ERROR, "gone; no room")]


def test_what_the_log_has_already_is_not_said_again(checked: SelfCheck, caplog: pytest.LogCaptureFixture) -> None:
    checked.add("thing", lambda: Look("gone", said=True))
    checked.look(slow=False)
    assert entry(checked, "thing")["found"] == "gone"
    assert caplog.records == []


def test_a_check_that_breaks_keeps_no_other_from_looking(checked: SelfCheck, caplog: pytest.LogCaptureFixture) -> None:
    def broken() -> Look:
        raise ValueError("bad inode")

    checked.add("broken", broken)
    checked.add("other", lambda: Look("found"))
    for _ in range(3):
        checked.look(slow=False)
    assert not entry(checked, "broken")["ok"]
    assert entry(checked, "broken")["found"] == "the look at it failed: ValueError: bad inode"
    assert entry(checked, "other")["found"] == "found"
    assert caplog.text.count("bad inode") == 1


def test_what_is_seen_of_an_end_is_not_said(checked: SelfCheck, caplog: pytest.LogCaptureFixture) -> None:
    def ended_meanwhile() -> Look:
        checked.end()
        return Look("gone")

    checked.add("thing", ended_meanwhile)
    checked.look(slow=False)
    assert (entry(checked, "thing")["found"], caplog.records) == (None, [])


def test_a_check_that_hangs_on_a_disk_is_seen_by_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hapticd.service.self_check.HANGS_S", 0.1)
    hung, looks = threading.Event(), []
    checked = SelfCheck(0.01)

    def hang() -> Look:
        hung.wait(60)
        return Look()

    checked.add("room", hang, slow=True)
    checked.add("socket", lambda: looks.append(1) or Look())  # type: ignore[func-returns-value]
    wait_until(lambda: not entry(checked, "self_check")["ok"], "a word about the one that hangs")
    assert "the look at room has not come back" in entry(checked, "self_check")["found"]
    assert entry(checked, "room")["age_s"] > 0.1
    looked = len(looks)
    wait_until(lambda: len(looks) > looked + 3, "looks of the others")
    hung.set()
    wait_until(lambda: entry(checked, "self_check")["ok"], "all is well again")
    assert checked.alive() == {"hapticd-check": True, "hapticd-check-disk": True}
    checked.end()


def test_sockets_and_lock_are_taken_anew_and_the_server_is_told(tmp_path: Path) -> None:
    told: list[Any] = []
    bound = bind(tmp_path / "run" / "h.sock")
    old = bound.socket
    check = checks.SocketCheck([(bound, told.append)], lambda: pytest.fail("it can be reached"), pytest.fail)
    assert check() == Look(mended=True)
    shutil.rmtree(tmp_path / "run")
    shutil.rmtree(tmp_path / "state")
    look = check()
    assert look.mended
    assert look.found is not None
    assert f"the socket {bound.path} was removed or replaced" in look.found
    assert f"the lock {bound.lock and bound.lock.path} was removed" in look.found
    assert look.done == f"bound anew at {bound.path}; taken anew"
    assert told == [bound.socket]
    assert check().found is None
    old.close()
    bound.close()


def test_who_cannot_be_reached_by_anybody_switches_the_motor_off_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped: list[int] = []
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(checks, "time", SimpleNamespace(monotonic=lambda: clock.now))
    bound = bind(tmp_path / "run" / "h.sock")
    check = checks.SocketCheck([(bound, None)], lambda: stopped.append(1), pytest.fail)
    shutil.rmtree(tmp_path / "run")
    (tmp_path / "run").write_text("in the way")
    for clock.now in (0.0, 1.0, checks.OUT_OF_REACH_S - 0.1):
        look = check()
        assert (look.mended, stopped) == (False, [])
        assert look.done.endswith("is not a directory")
    for clock.now in (checks.OUT_OF_REACH_S, checks.OUT_OF_REACH_S + 1):
        look = check()
        assert look.done.endswith("the motor is off")
        assert stopped == [1]
    (tmp_path / "run").unlink()
    old = bound.socket
    assert check().mended
    assert bound.intact()
    old.close()
    bound.close()


@pytest.mark.parametrize("place", ["h.sock", "h.sock.stop"])
def test_where_another_daemon_has_the_place_this_one_ends_at_once(tmp_path: Path, place: str) -> None:
    """And leaves the other's sockets, also that of datagrams, which says nothing of itself."""
    ended: list[str] = []
    path = tmp_path / "run" / "h.sock"
    sockets = [bind(path), bind(stop_path(path), kind=SOCK_DGRAM)]
    check = checks.SocketCheck([(each, None) for each in sockets], lambda: pytest.fail("at once"), ended.append)
    (path.parent / place).unlink()
    with socket(AF_UNIX, SOCK_DGRAM if place.endswith(".stop") else SOCK_STREAM) as other:
        other.bind(str(path.parent / place))
        if place == "h.sock":
            other.listen()
        look = check()
        assert ended[0].startswith(f"another daemon answers on {path.parent / place}: ")
        assert look.found == f"the socket {path.parent / place} was removed or replaced"
        assert look.done.endswith("the motor is off, and this daemon ends")
        assert not look.mended
        there = (path.parent / place).lstat()
    for each in sockets:
        each.close()
    assert os.path.samestat((path.parent / place).lstat(), there)


def test_a_flight_recorder_that_is_removed_is_said(tmp_path: Path) -> None:
    ring = FlightRing.create(tmp_path, "rig", 16)
    rig: Any = SimpleNamespace(flight=None, closed=False)
    look = checks.flight_recorder(lambda: rig)
    assert look() == Look()
    rig.flight = ring
    assert look() == Look()
    ring.path.rename(tmp_path / "elsewhere")
    assert look().found == f"the flight recorder {ring.path} was removed or replaced"
    ring.path.write_bytes(b"")
    assert not look().mended
    assert "I²t" in look().done
    rig.closed = True
    assert look() == Look()


def test_a_fault_that_could_not_be_latched_is_said_before_it_comes(tmp_path: Path) -> None:
    state = tmp_path / "state"
    look = checks.latch(lambda: latch_unwritable(state / "hapticd" / "fault-h.json"))
    assert look() == Look()
    state.write_text("in the way")
    assert look().found is not None
    assert str(look().found).startswith(f"a fault would not outlive a restart: {state}")
    state.unlink()
    assert look() == Look()


def test_threads_that_have_ended_are_named() -> None:
    alive = {"hapticd-api": True, "hapticd-recorder": True}
    look = checks.threads(lambda: alive)
    assert look() == Look()
    alive["hapticd-recorder"] = False
    assert look().found == "the thread hapticd-recorder has ended"


def test_limits_that_are_off_are_named() -> None:
    off: list[str] = []
    look = checks.limits(lambda: off)
    assert look() == Look()
    off += ["safety.max_velocity", "amplifier.peak_current"]
    assert look().found == "no limit is set by safety.max_velocity, amplifier.peak_current"


def test_what_the_recorder_says_of_its_file_is_in_the_document() -> None:
    status: dict[str, Any] = {"error": None, "continued": None, "stalled_s": 0.0}
    recorder: Any = SimpleNamespace(status=lambda: status)
    look = checks.run_file(lambda: recorder)
    assert look() == Look()
    status["stalled_s"] = 2.0
    assert look().found == "the disk of the recording does not answer"
    status["continued"] = "a.arrow was deleted; the recording goes on in b.arrow"
    assert (look().mended, look().found, look().said) == (True, status["continued"], True)
    status["error"] = "recording stopped: the disk is full"
    assert (look().mended, look().found) == (False, status["error"])


Room = namedtuple("Room", ["f_bavail", "f_frsize"])


@pytest.fixture
def room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A disk with a given room, a recorder of 100 bytes a row and 1 kHz: 6 MB a minute."""
    made = SimpleNamespace(free=10**9, keep=None, path=None, directory=tmp_path / "runs")
    recorder: Any = SimpleNamespace(
        directory=made.directory, status=lambda: {"bytes_per_row": 100.0, "path": made.path}
    )
    config: Any = SimpleNamespace
    monkeypatch.setattr(os, "statvfs", lambda path: Room(made.free // 1000, 1000))
    monkeypatch.setattr(checks, "KEEP_EVERY_S", 0.0)
    made.check = checks.RoomCheck(
        lambda: config(servo=config(rate_hz=1000.0), record=config(keep=made.keep)), lambda: recorder
    )
    return made


def test_the_room_is_given_in_minutes_and_said_when_it_ends(room: Any) -> None:
    room.free = 6_000_000 * 60
    assert room.check().found is None
    assert room.check().figures["minutes_left"] == pytest.approx(60.0)
    for minutes, low in ((11, False), (9, True), (11, True), (13, False)):
        room.free = 6_000_000 * minutes
        look = room.check()
        assert (look.found is not None) == low, minutes
        assert look.mended is False
        assert look.figures["minutes_left"] == pytest.approx(minutes)


def test_the_oldest_runs_are_removed_beyond_record_keep(room: Any) -> None:
    room.directory.mkdir()
    for number in range(3):
        path = room.directory / f"run-20200101T00000{number}.000Z.arrow"
        path.write_bytes(bytes(1000))
        os.utime(path, (number, number))
    assert room.check().figures.keys() == {"minutes_left", "free_bytes"}
    room.keep = 3000
    assert (room.check().found, room.check().figures["run_files_bytes"]) == (None, 3000.0)
    room.keep = 1500
    look = room.check()
    assert look.mended
    assert look.done == "removed 2, the oldest: run-20200101T000000.000Z.arrow, run-20200101T000001.000Z.arrow"
    assert [path.name for path in room.directory.iterdir()] == ["run-20200101T000002.000Z.arrow"]
    room.keep, room.path = 10, str(path)
    look = room.check()
    assert (look.mended, look.found) == (
        False,
        f"the run files in {room.directory} are larger than record.keep = 10 bytes",
    )
