"""What a recording loses while its disk hangs: the write call of the run file does not return for a while, at 10 kHz."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hapticd.config import parse_config
from hapticd.record import read_run, verify, writer
from hapticd.record.schema import FLAG_MISSED_PERIOD
from hapticd.service.rig import Rig
from hapticd.servo import thread

pytestmark = pytest.mark.realtime


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """Writes of a run file wait until it is set."""
    answers = threading.Event()

    def write(descriptor: int, data: bytes) -> int:
        answers.wait()
        return os.write(descriptor, data)

    monkeypatch.setattr(writer, "os", SimpleNamespace(**{**vars(os), "write": write}))
    yield answers
    answers.set()


@pytest.mark.parametrize(
    ("seconds", "ring", "is_lossy"),
    [
        (0.5, 1024, True),
        pytest.param(30.0, None, False, marks=pytest.mark.attack),
        pytest.param(10.0, 65536, True, marks=pytest.mark.attack),
    ],
)
def test_what_is_lost_is_told(
    disk: threading.Event,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    seconds: float,
    ring: int | None,
    is_lossy: bool,
) -> None:
    if ring is not None:
        monkeypatch.setattr(thread, "ring_rows", lambda rate_hz: ring)
    sections = {
        "servo": {"rate_hz": 10_000, "overrun": {"fault_after": None}},
        "safety": {"heartbeat_timeout_s": 10},
        "record": {"directory": str(tmp_path)},
    }
    rig = Rig(parse_config(sections, "test"))
    try:
        disk.set()
        path = rig.recorder.start(tmp_path / "run.arrow")
        for wait_s, change in ((0.5, disk.clear), (seconds, disk.set), (0.5, disk.set)):
            end = time.monotonic() + wait_s
            while time.monotonic() < end:
                rig.servo.beat()
                time.sleep(0.02)
            change()
        rig.recorder.stop()
    finally:
        disk.set()
        rig.close()
    run = read_run(path)
    tick, flags = run.columns["tick"], run.columns["flags"]
    gaps = (np.diff(tick) > 1) & ((flags[1:] & FLAG_MISSED_PERIOD) == 0)
    lost = int(np.sum((np.diff(tick) - 1)[gaps]))
    told = sum(event["rows"] for event in run.events if event["event"] == "dropped")
    assert verify(path).damage_text == []
    assert told >= lost
    assert (told > 0) == is_lossy
