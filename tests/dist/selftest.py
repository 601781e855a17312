"""What an installed hapticd must be able to do, with the standard library alone: run by the interpreter it is installed for.

``python selftest.py`` prints a JSON document: the versions it found, and the first step that failed with its last
words. Each step is the command line of a user: theory, simulation, the daemon on the simulated testbed from start to end,
its recording in every format, the live view's server, and every driver loaded.
"""

from __future__ import annotations

import json
import os
import platform
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from importlib.metadata import version
from pathlib import Path

PACKAGES = ("numpy", "numba", "scipy", "pandas", "pyarrow", "matplotlib", "pydantic", "fastapi", "typer")
LONGEST_S = 900.0
"""A step may compile all that there is."""


class FailedError(Exception):
    """A step did not do what it should."""


class Installed:
    """The ``hapticd`` beside this interpreter, in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._program = Path(sys.executable).parent / "hapticd"
        folders = {f"XDG_{kind}_HOME": str(folder / kind) for kind in ("CACHE", "CONFIG", "DATA", "STATE")}
        self._environment = {**os.environ, **folders, "HAPTICD_SOCKET": str(folder / "s")}
        self._running: list[subprocess.Popen[str]] = []

    def run(self, *words: str) -> str:
        """What one command prints."""
        command = [self._program, *words]
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            cwd=self.folder,
            env=self._environment,
            timeout=LONGEST_S,
            check=False,
        )
        if done.returncode != 0:
            raise FailedError(f"hapticd {' '.join(words)}: exit {done.returncode}: {done.stderr[-600:].strip()}")
        return done.stdout

    def start(self, *words: str) -> subprocess.Popen[str]:
        """Leave one running until `end`."""
        with (self.folder / f"{words[0]}.log").open("w") as log:
            process = subprocess.Popen(
                [self._program, *words],
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                cwd=self.folder,
                env=self._environment,
            )
        self._running.append(process)
        return process

    def status(self) -> dict[str, object]:
        """The daemon's, once it answers."""
        deadline = time.monotonic() + LONGEST_S
        while not (self.folder / "s").exists():
            if self._running[0].poll() is not None or time.monotonic() > deadline:
                raise FailedError(f"hapticd run: {(self.folder / 'run.log').read_text()[-600:].strip()}")
            time.sleep(0.2)
        found: dict[str, object] = json.loads(self.run("status", "--json"))
        return found

    def end(self) -> None:
        """End what was left running, the newest first, and see that each ends well."""
        while self._running:
            process = self._running.pop()
            process.send_signal(signal.SIGTERM)
            process.communicate(timeout=60)
            if process.returncode not in (0, -signal.SIGTERM):
                raise FailedError(f"SIGTERM: exit {process.returncode}")


def expect(condition: bool, what: str) -> None:
    """Raise `FailedError` unless it holds."""
    if not condition:
        raise FailedError(what)


def theory(hapticd: Installed) -> None:
    """A verdict and a simulation with the outcome it promises."""
    hapticd.run("check")
    found = json.loads(
        hapticd.run("simulate", "--duration", "1", "--deflection", "20.3", "-o", "simulated.arrow", "--json")
    )
    expect(found["outcome"] in ("monotone", "decaying"), f"simulate: {found['outcome']}")


def daemon(hapticd: Installed) -> None:
    """Start, change, release, stop; then what it recorded."""
    hapticd.start("run", "--set", "servo.overrun.fault_after=0")
    expect(hapticd.status()["state"] == "off", "run: not off at first")
    hapticd.run("start")
    hapticd.run("set", "spring.stiffness=0.02")
    time.sleep(1)
    status = hapticd.status()
    expect(status["state"] == "running", f"start: {status['state']}, fault {status['fault']}")
    hapticd.run("release", "--deflection", "5", "--duration", "1", "-o", "release.arrow")
    hapticd.run("stop")
    expect(hapticd.status()["state"] == "off", "stop: not off")


def live_view(hapticd: Installed) -> None:
    """The page comes, and the daemon's metrics."""
    server = hapticd.start("scope", "--port", "0", "--json")
    assert server.stdout is not None
    text = ""
    while not text.rstrip().endswith("}"):
        line = server.stdout.readline()
        expect(line != "", f"scope: {(hapticd.folder / 'scope.log').read_text()[-600:].strip()}")
        text += line
    with urllib.request.urlopen(json.loads(text)["url"].split("#")[0], timeout=20) as page:
        expect(b"<html" in page.read(), "scope: no page")
    expect("hapticd_" in hapticd.run("metrics"), "metrics: none")


def recording(hapticd: Installed) -> None:
    """Checksums, formats, a figure, energies, a device's parameters."""
    hapticd.run("verify", "release.arrow")
    for format_ in ("csv", "parquet", "mat", "mcap"):
        hapticd.run("export", "release.arrow", "--to", format_)
    hapticd.run("import", "release.mcap", "-o", "again.arrow")
    hapticd.run("plot", "release.arrow", "-o", "release.png")
    hapticd.run("energy", "release.arrow")


def main() -> None:
    """Run every step until one fails."""
    found = {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}, "failed": ""}
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="hd-") as name:
        hapticd = Installed(Path(name))
        try:
            theory(hapticd)
            daemon(hapticd)
            live_view(hapticd)
            hapticd.end()
            recording(hapticd)
            hapticd.run("drivers")
        except (FailedError, subprocess.TimeoutExpired, KeyError, ValueError) as error:
            found["failed"] = f"{type(error).__name__}: {error}"
        finally:
            for process in hapticd._running:
                process.kill()
    print(json.dumps({**found, "seconds": round(time.monotonic() - began)}))


if __name__ == "__main__":
    main()
