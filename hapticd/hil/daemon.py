"""The daemon as a child process, on a config that leads it to the simulated device."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from hapticd.client import Client, DaemonUnreachable
from hapticd.config import Config, config_to_yaml
from hapticd.config.loading import parse_config
from hapticd.hil.process import Child

START_TIMEOUT_S = 180.0
"""The first start on a machine compiles the servo loop."""


class DaemonProcess(Child):
    """``hapticd run`` with state, socket and recordings in a folder of its own.

    Args:
        config: what it shall run, but for these places.
        folder: takes them; its path must leave room for a Unix socket's name.
        driver_options: put over the config's own.
    """

    def __init__(self, config: Config, folder: Path, driver_options: dict[str, Any]) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        data = config.model_dump()
        data["driver"] |= driver_options
        data["api"]["socket"] = str(folder / "hapticd.sock")
        data["record"]["directory"] = str(folder / "runs")
        self.config = parse_config(data, "the suite's config")
        self.runs = folder / "runs"
        path = folder / "config.yaml"
        path.write_text(config_to_yaml(self.config))
        self.client = Client(folder / "hapticd.sock")
        super().__init__(
            "the daemon",
            [sys.executable, "-m", "hapticd.cli", "run", str(path)],
            folder / "daemon.out",
            {"XDG_STATE_HOME": str(folder / "state")},
        )

    def wait_ready(self) -> None:
        """Wait until it answers.

        Raises:
            HilError: it ended, or did not answer in time.
        """
        self.wait_until(self._answers, "it answered", START_TIMEOUT_S)

    def _answers(self) -> bool:
        try:
            self.client.status()
        except DaemonUnreachable:
            return False
        return True

    def wait_state(self, *states: str, timeout_s: float = 10.0) -> dict[str, Any]:
        """Wait for one of these states and return the status."""
        self.wait_until(lambda: self.client.status()["state"] in states, f"the state {' or '.join(states)}", timeout_s)
        return self.client.status()
