"""The flight recorder's file: what a dead process leaves in it, and what a power cut may."""

from __future__ import annotations

import os
import random
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from record_samples import make_rows

from hapticd.record import RecordingError, RunFileError
from hapticd.record.flight import FlightRing, dead, in_memory, read
from hapticd.record.schema import ROW, Rows

SLOTS = 1 << 12


def fill(ring: FlightRing, count: int, rate_hz: float = 1000.0) -> Rows:
    """Store rows as the servo does: row n in its slot, then the head."""
    rows = make_rows(count, 0, rate_hz)
    for number in range(max(0, count - SLOTS), count):
        ring.rows[number % SLOTS] = rows[number]
    ring.shared[0] = count
    return rows


def left_by(ring: FlightRing) -> tuple[Rows, int]:
    with ring.path.open("rb") as file:
        flight = read(ring.path, file.fileno())
    return flight.rows, flight.torn


@pytest.fixture
def ring(tmp_path: Path) -> FlightRing:
    return FlightRing.create(tmp_path, "rig", SLOTS)


@pytest.mark.parametrize("count", [0, 1, 7, SLOTS - 1, SLOTS, SLOTS + 1, 3 * SLOTS + 5])
def test_every_finished_row_is_read_back(ring: FlightRing, count: int) -> None:
    rows = fill(ring, count)
    if count:
        # The slot that comes next may be half written when the process dies.
        ring.rows[count % SLOTS]["tick"] = 10**9
    found, torn = left_by(ring)
    kept = min(count, SLOTS - 1)
    assert found.tobytes() == rows[count - kept :].tobytes()
    assert torn == 0


def test_only_the_last_ten_seconds_are_kept(ring: FlightRing) -> None:
    rows = fill(ring, SLOTS - 1, rate_hz=100.0)
    found, _ = left_by(ring)
    assert found.size in (1000, 1001)
    assert found.tobytes() == rows[-found.size :].tobytes()


@pytest.mark.parametrize("seed", range(30))
def test_pages_that_a_power_cut_left_old_cost_their_rows_and_no_others(ring: FlightRing, seed: int) -> None:
    """Any page of the file may be a lap behind, or never written; no row that is read is a mixture."""
    chance = random.Random(seed)
    rows = fill(ring, SLOTS + chance.randrange(SLOTS))
    newest = len(rows)
    memory = ring.rows.view(np.uint8)
    old = np.zeros(SLOTS, ROW)
    if seed % 2:
        old[:] = make_rows(SLOTS, 0)
        old["time_s"] -= 100.0
    old_bytes = old.view(np.uint8)
    torn_pages = [page for page in range(0, len(memory), 4096) if chance.random() < 0.2]
    for page in torn_pages:
        memory[page : page + 4096] = old_bytes[page : page + 4096]
    found, torn = left_by(ring)
    assert torn > 0
    assert np.all(np.diff(found["tick"]) > 0)
    # An old lap's rows are older than ten seconds; what is left is bit for bit what was written.
    written = {row["tick"]: row.tobytes() for row in rows}
    recent = [row for row in found if row["tick"] > newest - SLOTS]
    assert len(recent) >= len(found) - 1
    assert all(row.tobytes() == written[row["tick"]] for row in recent)
    touched = {byte // ROW.itemsize for page in torn_pages for byte in (page, min(page + 4095, len(memory) - 1))}
    hit = sum(
        len(range(page // ROW.itemsize, min(page + 4095, len(memory) - 1) // ROW.itemsize + 1)) for page in torn_pages
    )
    assert len(found) >= SLOTS - 1 - hit - 2 * len(touched)


def test_metadata_survives_a_torn_write(ring: FlightRing) -> None:
    ring.describe({"config": {"a": 1}})
    ring.describe({"config": {"a": 2}})
    with ring.path.open("rb") as file:
        assert read(ring.path, file.fileno()).metadata == {"config": {"a": 2}}
    data = bytearray(ring.path.read_bytes())
    at = data.index(b'{"config": {"a": 2}}')
    data[at + 12] ^= 1
    ring.path.write_bytes(data)
    with ring.path.open("rb") as file:
        assert read(ring.path, file.fileno()).metadata == {"config": {"a": 1}}


def test_who_lives_is_left_alone_and_who_died_is_not(tmp_path: Path) -> None:
    child = os.fork()
    if child == 0:
        ring = FlightRing.create(tmp_path, "rig", SLOTS)
        fill(ring, 100)
        signal.pause()
        os._exit(1)
    deadline = time.monotonic() + 30
    while not (files := list(tmp_path.glob("*.flight"))) and time.monotonic() < deadline:
        time.sleep(0.01)
    with dead(files[0]) as flight:
        assert flight is None
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    with dead(files[0]) as flight:
        assert flight is not None
        assert flight.pid == child
    with dead(tmp_path / "gone.flight") as flight:
        assert flight is None


def test_what_is_no_flight_recorder_is_refused(tmp_path: Path, ring: FlightRing) -> None:
    data = ring.path.read_bytes()
    ring.leave()
    cases = {
        "short": (data[:100], "no flight recorder: 100 bytes"),
        "text": (b"a" * 8192, "is no flight recorder"),
        "cut": (data[:-4096], "is cut short"),
        "other": (data[:8] + b"\1" + data[9:], "another version"),
        "huge": (data[:16] + b"\xff" * 7 + data[23:], "another version"),
    }
    for name, (content, message) in cases.items():
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(RunFileError, match=message), dead(path):
            pass
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(RunFileError, match="it is a pipe"), dead(tmp_path / "pipe"):
        pass


def test_no_room_is_said_and_nothing_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int, offset: int, length: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(RecordingError, match=r"no flight recorder in .*: No space left on device \(0 MiB\)"):
        FlightRing.create(tmp_path, "rig", SLOTS)
    assert list(tmp_path.iterdir()) == []


def test_an_end_in_order_leaves_nothing(ring: FlightRing) -> None:
    ring.remove()
    ring.remove()
    assert not ring.path.exists()
    ring.rows["tick"] = 1  # its memory is still there for whoever holds it


def test_memory_is_told_from_a_disk(tmp_path: Path) -> None:
    assert not in_memory(Path("/proc/self"))
    assert not in_memory(tmp_path / "nothing")
    if Path("/dev/shm").is_dir():
        assert in_memory(Path("/dev/shm"))
