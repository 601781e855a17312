"""The live stream of a real daemon: every row, in order, numbered; nothing for nobody; nothing left by those who vanish."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hapticd.record.frames import PREFIX, Context, decode
from hapticd.record.schema import Rows, empty_rows
from hapticd.service.api import ApiServer
from hapticd.service.daemon import Daemon
from hapticd.service.live import MAX_READERS, WAITING_FRAMES, LiveStream
from hapticd.service.refusals import Refused
from hapticd.service.socket import bind
from tests.polling import wait_until

from .daemons import daemon_on, state_home  # noqa: F401

REQUEST = b"GET /stream HTTP/1.0\r\nHost: hapticd\r\n\r\n"


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[tuple[Daemon, Path]]:
    path = tmp_path / "h.sock"
    with daemon_on(monkeypatch, tmp_path) as (daemon, _):
        server = ApiServer(daemon, bind(path))
        server.start()
        try:
            yield daemon, path
        finally:
            server.stop()


def connect(path: Path) -> socket.socket:
    found = socket.socket(socket.AF_UNIX)
    found.settimeout(20)
    found.connect(str(path))
    found.sendall(REQUEST)
    return found


def frames(connection: socket.socket) -> Iterator[tuple[Rows, Context]]:
    file = connection.makefile("rb")
    while file.readline() not in (b"\r\n", b""):
        pass
    while prefix := file.read(PREFIX.size):
        yield decode(file.read(PREFIX.unpack(prefix)[0]))


def test_every_row_comes_once_and_in_order(served: tuple[Daemon, Path]) -> None:
    daemon, path = served
    with connect(path) as connection:
        next_row, last_tick, rows_seen, times = None, None, 0, []
        for rows, context in frames(connection):
            if not len(rows):
                continue
            if next_row is not None:
                assert context.first_row == next_row
                assert rows["tick"][0] > last_tick
            next_row, last_tick = context.first_row + len(rows), rows["tick"][-1]
            times += list(rows["time_s"])
            rows_seen += len(rows)
            if rows_seen > 500:
                break
    assert context.period_s == daemon.rig.config.period
    assert abs(context.unix_s - time.time()) < 5
    assert np.all(np.diff(times) > 0)


def test_a_changed_setting_changes_the_epoch(served: tuple[Daemon, Path]) -> None:
    daemon, path = served
    with connect(path) as connection:
        stream = frames(connection)
        _, before = next((rows, context) for rows, context in stream if len(rows))
        daemon.set({"servo.rate_hz": 500})
        for rows, context in stream:
            if len(rows) and context.epoch != before.epoch:
                break
    assert context.epoch == daemon.status()["settings_epoch"] == before.epoch + 1
    assert context.period_s == 0.002


def test_nothing_is_paid_when_nobody_looks(served: tuple[Daemon, Path]) -> None:
    daemon, path = served
    assert not daemon.live.watched
    with connect(path) as connection:
        next(frames(connection))
        assert daemon.live.watched
    wait_until(lambda: not daemon.live.watched, "an idle stream")


def test_fifty_readers_that_vanish_leave_nothing(served: tuple[Daemon, Path]) -> None:
    daemon, path = served

    def left() -> tuple[int, int]:
        return threading.active_count(), len(list(Path("/proc/self/fd").iterdir()))

    with connect(path) as connection:
        next(frames(connection))
    wait_until(lambda: not daemon.live.watched, "an idle stream")
    before = left()
    for number in range(50):
        connection = connect(path)
        if number % 2:
            connection.recv(1000)
        connection.close()
    wait_until(lambda: left() <= before, f"no more than {before} threads and descriptors")
    wait_until(lambda: not daemon.live.watched, "an idle stream")


def test_a_stalled_reader_costs_the_others_nothing(served: tuple[Daemon, Path]) -> None:
    _, path = served
    with connect(path) as stalled, connect(path) as connection:
        expected, seen = None, 0
        for rows, context in frames(connection):
            if len(rows):
                assert expected in (None, context.first_row)
                expected, seen = context.first_row + len(rows), seen + len(rows)
            if seen > 1500:
                break
        assert stalled.recv(1)  # it is still there


def test_a_reader_too_many_is_refused(served: tuple[Daemon, Path]) -> None:
    daemon, path = served
    connections = [connect(path) for _ in range(MAX_READERS)]
    for connection in connections:
        next(frames(connection))
    with pytest.raises(Refused, match="16 readers look at the stream already"):
        daemon.live.refuse_more()
    with connect(path) as one_more:
        assert b"409" in one_more.recv(100)
    for connection in connections:
        connection.close()


def test_who_falls_behind_loses_the_oldest_frames_and_the_numbers_say_so() -> None:
    async def read() -> list[int]:
        stream = LiveStream()
        chunks = stream.chunks()
        looking = asyncio.ensure_future(anext(chunks))
        await asyncio.sleep(0)
        for number in range(WAITING_FRAMES + 10):  # a row is missing after each, so that each is a frame of its own
            stream.put(empty_rows(1), Context(2 * number, 0, 1, 1e-3, 0, 0.0))
        chunk, found = await looking, []
        await chunks.aclose()
        while chunk:
            size = PREFIX.unpack_from(chunk)[0]
            found.append(decode(chunk[PREFIX.size : PREFIX.size + size])[1].first_row)
            chunk = chunk[PREFIX.size + size :]
        return found

    assert asyncio.run(read()) == list(range(20, 2 * WAITING_FRAMES + 20, 2))


def test_a_stream_that_ends_takes_nobody_and_lets_everybody_go() -> None:
    stream = LiveStream()

    async def read() -> int:
        chunks = 0
        async for _ in stream.chunks():
            chunks += 1
            stream.close()
        return chunks

    assert asyncio.run(asyncio.wait_for(read(), 10)) == 1
    with pytest.raises(Refused, match="the daemon ends"):
        stream.refuse_more()
