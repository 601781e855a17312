"""Notes and markers in the running recording, and what a recording is of."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.config import ConfigError
from hapticd.record import read_run
from hapticd.record.listing import listed
from hapticd.service.daemon import Daemon
from hapticd.service.refusals import Refused
from tests.service.daemons import daemon_on, state_home

__all__ = ["state_home"]


def noted(daemon: Daemon) -> list[tuple[str, Any]]:
    events = daemon.status()["recorder"]["notes"]
    return [(event["event"], event.get("text") or (event["name"], event["value"])) for event in events]


def test_notes_stand_in_the_run_at_their_ticks(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path) as (daemon, _):
        with pytest.raises(Refused) as error:
            daemon.note("nobody records")
        assert error.value.code == "recording"
        daemon.set({"record.subject": "S07", "record.condition": "stiff"})
        daemon.start()
        time.sleep(0.2)
        said = daemon.note("the operator let go")
        marked = [daemon.marker("trial", 17), daemon.marker("stimulus")]
        time.sleep(0.2)
        assert noted(daemon) == [
            ("note", "the operator let go"),
            ("marker", ("trial", 17)),
            ("marker", ("stimulus", None)),
        ]
        daemon.stop()
        path = Path(said["path"])
        run = read_run(path)
        events = [event for event in run.events if event["event"] in ("note", "marker")]
        assert [event["tick"] for event in events] == [said["tick"], *(each["tick"] for each in marked)]
        ticks = run.columns["tick"]
        for event in events:  # the row is that of the tick, or of one that came before the recorder was asked
            assert 0 <= ticks[event["row"]] - event["tick"] < 500
        assert np.all(np.diff([event["row"] for event in events]) >= 0)
        found = listed(path)
        assert (found.subject, found.condition) == ("S07", "stiff")
        after_s = [note["after_s"] for note in found.notes]
        assert after_s == sorted(after_s)
        assert 0.1 < after_s[0] < found.duration_s
        # the next recording begins without them, and is of the same
        daemon.start()
        assert noted(daemon) == []
        daemon.stop()


def test_a_label_is_text(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path) as (daemon, _):
        before = daemon.status()["config_digest"]
        for wrong in ("true", '""', "1.5", "x" * 201):
            with pytest.raises(ConfigError):
                daemon.set({"record.subject": wrong})
        for said, kept in (("07", "07"), ("7", "7"), ('"8"', "8"), ("S 9", "S 9")):
            daemon.set({"record.subject": said})
            assert daemon.config()["record"]["subject"] == kept
        assert daemon.status()["config_digest"] == before
        daemon.set({"record.subject": None})
        assert daemon.config()["record"]["subject"] is None
