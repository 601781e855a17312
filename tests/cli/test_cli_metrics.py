"""``hapticd metrics``, and where commands look for a daemon."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from hapticd.client import textfile
from hapticd.config import paths

from ..service.fake_control import FakeControl, serve
from .conftest import Run

TEXT = """\
# HELP hapticd_ticks_total Servo ticks done
# TYPE hapticd_ticks_total counter
hapticd_ticks_total 1e+06
hapticd_state{state="off"} 1.0
hapticd_lateness_seconds_bucket{le="+Inf"} 7.0
"""


def test_label_goes_before_the_others_and_comments_stay() -> None:
    assert textfile.labelled(TEXT, None) == TEXT
    assert textfile.labelled(TEXT, 'a"b').splitlines()[1:] == [
        "# TYPE hapticd_ticks_total counter",
        'hapticd_ticks_total{testbed="a\\"b"} 1e+06',
        'hapticd_state{testbed="a\\"b",state="off"} 1.0',
        'hapticd_lateness_seconds_bucket{testbed="a\\"b",le="+Inf"} 7.0',
    ]


def test_on_stdout_as_text_and_as_json(daemon: Run) -> None:
    assert daemon("metrics").out.splitlines()[0] == "hapticd_ticks_total 1.0"
    document = daemon("metrics", "--testbed", "left", "--json").document
    assert document["samples"] == {'hapticd_ticks_total{testbed="left"}': 1.0, 'hapticd_up{testbed="left"}': 1.0}


def test_file_is_replaced_whole_and_readable_by_others(daemon: Run, tmp_path: Path) -> None:
    path = tmp_path / "left.prom"
    path.write_text("old")
    outcome = daemon("metrics", "-o", str(path))
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    assert path.read_text().endswith("hapticd_up 1\n")
    assert stat.S_IMODE(path.stat().st_mode) == 0o644
    assert [found.name for found in tmp_path.glob("*prom*")] == ["left.prom"]


def test_without_a_daemon_the_file_says_so(hapticd: Run, tmp_path: Path) -> None:
    path = tmp_path / "left.prom"
    outcome = hapticd("metrics", "--socket", str(tmp_path / "no.sock"), "--testbed", "left", "-o", str(path))
    assert outcome.code == 3
    assert textfile.samples(path.read_text()) == {'hapticd_up{testbed="left"}': 0.0}
    assert hapticd("metrics", "--socket", str(tmp_path / "no.sock")).code == 3


def test_folder_that_is_not_there_is_named(daemon: Run, tmp_path: Path) -> None:
    outcome = daemon("metrics", "-o", str(tmp_path / "gone" / "left.prom"))
    assert outcome.code == 2
    assert str(tmp_path / "gone") in outcome.err


def test_own_daemon_goes_before_the_service_and_the_service_before_nothing(
    hapticd: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(paths, "SERVICE_RUNTIME", tmp_path / "service")
    (tmp_path / "service").mkdir()
    service = paths.service_socket()
    assert f"no daemon answers on {tmp_path / 'hapticd.sock'}" in hapticd("status").err
    with serve(FakeControl(), service):
        assert str(service) in hapticd("status").out
        own = tmp_path / "hapticd.sock"
        with serve(FakeControl(), own):
            assert str(own) in hapticd("status").out
        monkeypatch.setenv("HAPTICD_SOCKET", str(tmp_path / "named.sock"))
        assert f"no daemon answers on {tmp_path / 'named.sock'}" in hapticd("status").err
