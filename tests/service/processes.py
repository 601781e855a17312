"""The daemon as a process of its own, on a device that writes down what it is told."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from hapticd.client import Client, DaemonUnreachable
from tests.forked import Forked
from tests.polling import PATIENCE_S, wait_until

HAPTICD = "hapticd.cli.main:main"
CONFIG: dict[str, Any] = {
    "driver": {"name": "witness"},
    "safety": {"heartbeat_timeout_s": 2},
    "servo": {"overrun": {"fault_after": None}},
    "amplifier": {"bandwidth_hz": 0, "dac_bits": 0},
}


class Rig:
    """One daemon process on the witness driver, in a folder of its own.

    Args:
        folder: of everything. socket: of the daemon, by default in there.
        sections: of the config, in the place of those of `CONFIG`.
    """

    def __init__(self, folder: Path, socket: Path | None = None, **sections: Any) -> None:
        self.folder = folder
        self.socket = socket or folder / "h.sock"
        self.log = folder / "witness.log"
        self.output = folder / "output.txt"
        self.config = folder / "rig.yaml"
        self.config.write_text(yaml.safe_dump({**CONFIG, **sections, "record": {"directory": str(folder / "runs")}}))
        plugin = folder / "plugin" / "witness-1.dist-info"
        plugin.mkdir(parents=True)
        (plugin / "METADATA").write_text("Metadata-Version: 2.1\nName: witness\nVersion: 1\n")
        (plugin / "entry_points.txt").write_text("[hapticd.drivers]\nwitness = tests.service.witness:Witness\n")
        root = Path(__file__).parents[2]
        self.environment = {
            **os.environ,
            "PYTHONPATH": f"{folder / 'plugin'}:{root}",
            "XDG_STATE_HOME": str(folder / "state"),
            "WITNESS": str(self.log),
        }
        self.environment.pop("HAPTICD_SOCKET", None)
        self.client = Client(self.socket)
        self.processes: list[Forked] = []

    def command(self, *words: str) -> subprocess.CompletedProcess[str]:
        """A command line against this daemon."""
        process = Forked(HAPTICD, words, self.folder, self.environment)
        output, errors = process.communicate(PATIENCE_S)
        assert process.returncode is not None
        return subprocess.CompletedProcess(words, process.returncode, output, errors)

    def launch(self, program: str = HAPTICD, output: Path | None = None, **environment: str) -> Forked:
        """Start the daemon and wait until it answers.

        Args:
            program: what runs the command line. output: what takes all that it prints; None: `output`.
            environment: more variables.
        """
        words = ["run", str(self.config), "--socket", str(self.socket)]
        process = Forked(program, words, self.folder, {**self.environment, **environment}, output or self.output)
        self.processes.append(process)
        wait_until(lambda: process.poll() is not None or self.answers(), "an answering daemon", 250)
        if process.poll() is not None:
            pytest.fail(f"the daemon ended: {self.output.read_text() if output is None else process.returncode}")
        return process

    def answers(self) -> bool:
        """Whether somebody answers on the socket."""
        try:
            self.client.status()
        except DaemonUnreachable:
            return False
        return True

    def commands(self) -> list[str]:
        """What the device was told, one line each."""
        return self.log.read_text().splitlines()

    def render(self) -> None:
        """Start the spring and wait for currents."""
        self.client.start()
        wait_until(lambda: sum(line[0] == "-" for line in self.commands()) > 20, "currents at the device")

    def check_end(self) -> None:
        """After the last current: zero with the amplifier on, zero with it off, closed."""
        lines = self.commands()
        last = max(index for index, line in enumerate(lines) if line[0] == "-")
        after = lines[last + 1 :]
        on = after.index("0.0 0")
        assert on >= 1, after[:5]
        assert set(after[:on]) == {"0.0 1"}, after[:5]
        assert set(after[on:-1]) == {"0.0 0"}, after[:5]
        assert after[-1] == "closed", after[-5:]


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    made = Rig(tmp_path)
    yield made
    for process in made.processes:
        process.close()
