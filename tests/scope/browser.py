"""Debian's Chromium for the tests, installed when it is missing and can be; and the processes it looks at."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from playwright.sync_api import Browser, sync_playwright

from hapticd.client import Client, DaemonUnreachable, RequestRefused
from hapticd.control.endpoints import Endpoint, JsonDict
from tests.installing import one_at_a_time
from tests.polling import wait_until

PROGRAMS = ("chromium-headless-shell", "chromium")
PACKAGES = ("chromium-headless-shell", "chromium")
ROOT = Path(__file__).parents[2]


def chromium() -> str:
    """Path of the browser; the test is skipped, with the reason, where there is none and no way to one."""
    if found := _found():
        return found
    with one_at_a_time():
        if not _found():
            _install()
    if found := _found():
        return found
    pytest.skip(f"no browser: neither of {', '.join(PACKAGES)} could be installed with apt-get")


def _found() -> str | None:
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


def _install() -> None:
    if not shutil.which("apt-get"):
        pytest.skip("no browser, and no apt-get to install Debian's chromium-headless-shell with")
    if os.geteuid() != 0:
        pytest.skip("no browser, and no right to install one: sudo apt-get install chromium-headless-shell")
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    quiet: dict[str, Any] = {"env": environment, "stdout": subprocess.DEVNULL, "check": False, "timeout": 900}
    subprocess.run(["apt-get", "update", "-q"], **quiet)
    for package in PACKAGES:
        words = ["apt-get", "install", "-y", "-q", "--no-install-recommends", package, "fonts-dejavu-core"]
        if subprocess.run(words, **quiet).returncode == 0:
            return


@contextmanager
def launched() -> Iterator[Browser]:
    """The browser, without a window."""
    path = chromium()
    with sync_playwright() as playwright:
        # Chromium's sandbox does not work for root.
        arguments = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = playwright.chromium.launch(executable_path=path, args=arguments)
        try:
            yield browser
        finally:
            browser.close()


class PatientClient(Client):
    """Asks again where a busy machine has come to a motion too late to begin it."""

    def send(self, endpoint: Endpoint, fields: JsonDict) -> Any:
        """As a person would."""
        while True:
            try:
                return super().send(endpoint, fields)
            except RequestRefused as refused:
                if refused.code != "expired":
                    raise


class Testbed:
    """A daemon on the loopback and a scope in front of it, as processes, in a folder of their own.

    Args:
        folder: for everything. config: sections of the daemon's config.
    """

    __test__ = False

    def __init__(self, folder: Path, **config: Any) -> None:
        self.folder = folder
        self.socket = folder / "h.sock"
        self.client = PatientClient(self.socket)
        self.url = self.view_url = ""
        base: dict[str, Any] = {
            "record": {"directory": str(folder / "runs")},
            "safety": {"heartbeat_timeout_s": 10},
            "servo": {"overrun": {"fault_after": None}},
        }
        sections = {name: {**base.get(name, {}), **config.get(name, {})} for name in base.keys() | config.keys()}
        (folder / "rig.yaml").write_text(yaml.safe_dump(sections))
        self.environment = {**os.environ, "PYTHONPATH": str(ROOT), "XDG_STATE_HOME": str(folder / "state")}
        self.environment.pop("HAPTICD_SOCKET", None)
        self.daemon: subprocess.Popen[Any] | None = None
        self.scope: subprocess.Popen[Any] | None = None

    def start_daemon(self) -> None:
        """Launch the daemon and wait until it answers."""
        process = self._launch("daemon", "run", str(self.folder / "rig.yaml"), "--socket", str(self.socket))
        self.daemon = process
        wait_until(lambda: process.poll() is not None or self.answers(), "an answering daemon", 250)
        assert process.poll() is None, (self.folder / "daemon.txt").read_text()

    def start_scope(self, *options: str) -> None:
        """Launch the scope and wait until it says where the page is."""
        output = self.folder / "scope.txt"
        self.scope = self._launch("scope", "scope", "--socket", str(self.socket), "--port", "0", "--json", *options)
        scope = self.scope
        wait_until(lambda: scope.poll() is not None or "pid" in output.read_text(), "the scope's URL", 250)
        assert scope.poll() is None, output.read_text()
        document = json.loads(output.read_text())
        self.url, self.view_url = document["url"], document["view_url"]

    def _launch(self, name: str, *words: str) -> subprocess.Popen[Any]:
        with (self.folder / f"{name}.txt").open("w") as output, (self.folder / f"{name}.err").open("w") as errors:
            line = [sys.executable, "-m", "hapticd.cli", *words]
            return subprocess.Popen(
                line, env=self.environment, stdout=output, stderr=output if name == "daemon" else errors, cwd=ROOT
            )

    def answers(self) -> bool:
        """Whether the daemon answers."""
        try:
            self.client.status()
        except DaemonUnreachable:
            return False
        return True

    def state(self) -> str:
        """The daemon's own word."""
        return str(self.client.status()["state"])

    def stop_daemon(self) -> None:
        """End the daemon as an operator would."""
        if self.daemon is not None:
            _end(self.daemon)

    def close(self) -> None:
        """End both."""
        for process in (self.scope, self.daemon):
            if process is not None:
                _end(process)


def _end(process: subprocess.Popen[Any]) -> None:
    if process.poll() is None:
        process.send_signal(signal.SIGCONT)
        process.terminate()
        try:
            process.wait(15)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
