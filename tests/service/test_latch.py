"""The latch needs no descriptor that it has not already, makes its folder anew, and is on disk before anything is logged."""

from __future__ import annotations

import json
import logging
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from hapticd.service.latch import FaultLatch
from tests.polling import wait_until
from tests.service.daemons import SOCKET, daemon_on, state_home, wait_for_state

pytestmark = pytest.mark.realtime
__all__ = ["state_home"]

FAULT = {"code": "over_speed", "cause": "speed 401 rad/s is above 400 rad/s"}


def no_descriptor(*_: Any, **__: Any) -> int:
    raise OSError(24, "Too many open files")


def test_storing_opens_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    latch = FaultLatch(SOCKET)
    latch.prepare()
    with monkeypatch.context() as exhausted:
        exhausted.setattr(os, "open", no_descriptor)
        exhausted.setattr("builtins.open", no_descriptor)
        exhausted.setattr("io.open", no_descriptor)
        latch.store(FAULT)
    assert (latch.load() or {})["cause"] == FAULT["cause"]
    latch.close()
    assert [path.name for path in latch.path.parent.iterdir()] == [latch.path.name]


def test_the_folder_is_made_anew() -> None:
    latch = FaultLatch(SOCKET)
    latch.prepare()
    shutil.rmtree(latch.path.parent)
    latch.store(FAULT)
    assert json.loads(latch.path.read_text())["code"] == "over_speed"
    latch.close()


def test_what_a_killed_daemon_had_prepared_is_swept_away() -> None:
    latch = FaultLatch(SOCKET)
    latch.path.parent.mkdir(parents=True)
    left = latch.path.parent / f".{latch.path.name}.1.part"
    left.write_text("")
    latch.prepare()
    assert not left.exists()
    latch.close()


def test_it_is_on_disk_before_a_word_is_logged(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    found: list[bool] = []

    class Handler(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.getMessage().startswith("fault estop"):
                found.append(FaultLatch(SOCKET).path.exists())

    handler = Handler()
    logging.getLogger("hapticd").addHandler(handler)
    try:
        with daemon_on(monkeypatch, tmp_path, lambda n: 0) as (daemon, _):
            daemon.estop()
            wait_until(lambda: bool(found), "the line in the log")
    finally:
        logging.getLogger("hapticd").removeHandler(handler)
    assert found == [True]


def test_what_cannot_be_latched_is_said_and_tried_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 0) as (daemon, _):
        with monkeypatch.context() as full:
            full.setattr(os, "fsync", lambda _: no_descriptor())
            daemon.estop()
            wait_until(lambda: daemon.status()["fault"]["not_latched"] is not None, "the reason")
            assert "would not outlive a restart" in daemon.status()["fault"]["not_latched"]
        wait_until(lambda: daemon.status()["fault"]["not_latched"] is None, "another attempt")
        assert FaultLatch(SOCKET).path.exists()
        daemon.clear()
        wait_for_state(daemon, "off")
        assert not FaultLatch(SOCKET).path.exists()
