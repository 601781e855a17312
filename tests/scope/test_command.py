"""``hapticd scope`` as a command: what it prints, refuses, and leaves behind."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from hapticd.cli.main import main
from tests.polling import wait_until

from .browser import ROOT


@contextmanager
def launched(folder: Path, *options: str) -> Iterator[tuple[subprocess.Popen[Any], Path, Path]]:
    output, errors = folder / "out.txt", folder / "err.txt"
    words = [sys.executable, "-m", "hapticd.cli", "scope", "--socket", str(folder / "h.sock"), "--port", "0", *options]
    with output.open("w") as out, errors.open("w") as err:
        process = subprocess.Popen(words, stdout=out, stderr=err, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)})
    try:
        yield process, output, errors
    finally:
        process.kill()
        process.wait()


def test_it_prints_two_urls_and_ends_on_ctrl_c(tmp_path: Path) -> None:
    with launched(tmp_path, "--json") as (process, output, errors):
        wait_until(lambda: "pid" in output.read_text(), "the URLs")
        document = json.loads(output.read_text())
        assert document["pid"] == process.pid
        url, token = document["url"].split("#")
        assert url == document["view_url"].split("#")[0]
        assert token != document["view_url"].split("#")[1]
        assert url.startswith("http://127.0.0.1:")
        assert httpx.get(url, timeout=30).status_code == 200
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 130
        assert "Traceback" not in errors.read_text()


def test_view_only_gives_no_url_with_the_controls(tmp_path: Path) -> None:
    with launched(tmp_path, "--json", "--view-only") as (_, output, _errors):
        wait_until(lambda: "pid" in output.read_text(), "the URLs")
        assert json.loads(output.read_text())["url"] is None


def test_the_url_file_is_for_owner_and_group_and_nothing_is_printed(tmp_path: Path) -> None:
    path = tmp_path / "url"
    path.write_text("old")
    path.chmod(0o666)
    with launched(tmp_path, "--url-file", str(path)) as (process, output, errors):
        wait_until(lambda: path.exists() and "pid" in path.read_text(), "the file")
        assert path.stat().st_mode & 0o137 == 0
        token = json.loads(path.read_text())["url"].split("#")[1]
        assert token not in output.read_text() + errors.read_text()
        process.send_signal(signal.SIGINT)
        process.wait(20)
    assert not path.exists()


def test_beyond_loopback_it_warns(tmp_path: Path) -> None:
    with launched(tmp_path, "--json", "--host", "0.0.0.0") as (_, output, errors):
        wait_until(lambda: "pid" in output.read_text(), "the URLs")
        assert "warning: whoever reaches 0.0.0.0 and has the URL can command the motor" in errors.read_text()


def test_a_port_that_is_taken_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["scope", "--port", str(port)]) == 2
    assert f"cannot serve on 127.0.0.1 port {port}" in capsys.readouterr().err


def test_an_origin_that_is_none_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scope", "--port", "0", "--origin", "lab-pc:9000"]) == 2
    assert "'lab-pc:9000' is not an origin" in capsys.readouterr().err
