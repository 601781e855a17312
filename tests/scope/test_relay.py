"""From the daemon's stream through the scope to its pages: a page that stalls loses rows, and nobody else does."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from websockets.sync.client import ClientConnection, connect

from hapticd.record.frames import Context, decode
from hapticd.record.schema import FLAG_CLAMPED, FLAG_FAULT, FLAG_RUNNING, empty_rows
from hapticd.scope import hub
from hapticd.service.live import LiveStream
from tests.polling import PATIENCE_S, wait_until
from tests.service.fake_control import FakeControl

from .served import CLIENT, Served

PORTION = 2000


@contextmanager
def rows_made(live: LiveStream) -> Iterator[None]:
    """A loop's rows, 400 000 a second, while anybody looks."""
    ending = threading.Event()

    def make() -> None:
        first = 0
        while not ending.wait(0.005):
            rows = empty_rows(PORTION)
            rows["tick"] = first + np.arange(PORTION)
            live.put(rows, Context(first, 0, 1, 5e-6, 0, time.time()))
            first += PORTION

    thread = threading.Thread(target=make)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()


@contextmanager
def page(scope: Served, name: str = "rows") -> Iterator[ClientConnection]:
    url = f"ws://127.0.0.1:{scope.port}/ws/{name}"
    # A page that stalls does not answer a close either: nothing is won by waiting for that.
    with connect(url, origin=scope.origin, compression=None, max_size=None, close_timeout=0.5) as connection:  # type: ignore[arg-type]
        connection.send(json.dumps({"token": scope.access.control_token, "client": CLIENT}))
        yield connection


def contexts(connection: ClientConnection) -> Iterator[tuple[int, int]]:
    """Number of the first row and of the one behind the last, frame by frame."""
    for message in connection:
        assert isinstance(message, bytes)
        rows, context = decode(message)
        if len(rows):
            assert rows["tick"][0] == context.first_row
            yield context.first_row, context.first_row + len(rows)


def test_a_stalled_page_loses_rows_and_the_others_none(scope: Served, control: FakeControl) -> None:
    with page(scope) as stalled, page(scope) as reading, rows_made(control.live):
        begin = end = None
        for first, after in contexts(reading):
            assert end in (None, first)
            begin, end = first if begin is None else begin, after
            if after - begin > 1_500_000:  # 54 MB: more than all buffers on the way to the other hold
                break
        missing, end = 0, None
        for first, after in contexts(stalled):
            missing += 0 if end is None else first - end
            end = after
            if missing:
                break
        assert missing > 0
    wait_until(lambda: not control.live.watched, "an idle daemon")


def test_nothing_is_asked_of_the_daemon_without_a_page(scope: Served, control: FakeControl) -> None:
    with rows_made(control.live):
        time.sleep(0.5)
        assert not control.live.watched
        with page(scope) as reading:
            next(contexts(reading))
            assert control.live.watched
        wait_until(lambda: not control.live.watched, "an idle daemon")
        assert scope.server.hub.rows == set()


def test_a_change_is_looked_at_as_soon_as_a_row_or_a_command_tells_of_it(
    scope: Served, control: FakeControl, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hub, "STATE_S", 1000.0)
    wait_until(lambda: not (scope.server.hub.rows or scope.server.hub.states), "the last test's pages to be gone")
    with page(scope) as rows, page(scope, "state") as state:

        def next_state() -> str:
            while (message := json.loads(state.recv(PATIENCE_S)))["type"] != "state":
                pass
            return str(message["status"]["state"])

        def put(row: int, flags: int, epoch: int) -> None:
            made = empty_rows(1)
            made["flags"] = flags
            control.live.put(made, Context(row, epoch, 1, 1e-3, 0, time.time()))
            while not len(decode(rows.recv(PATIENCE_S))[0]):  # type: ignore[arg-type]
                pass

        assert next_state() == "off"
        wait_until(lambda: control.live.watched, "a relay")
        put(0, 0, 0)
        assert next_state() == "off"
        for row, (flags, epoch) in enumerate([(FLAG_RUNNING, 0), (FLAG_FAULT, 0), (FLAG_FAULT, 1)], 1):
            control.state = f"changed {row}"
            put(row, flags, epoch)
            assert next_state() == f"changed {row}"
        put(4, FLAG_FAULT | FLAG_CLAMPED, 1)
        with pytest.raises(TimeoutError):
            state.recv(0.5)
        assert scope.post("start", {"force": False}).status_code == 200
        assert next_state() == "running"
