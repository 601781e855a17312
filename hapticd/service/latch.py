"""The latched fault on disk: a fault outlives the daemon, and only an explicit ``clear`` removes it."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from hapticd.figures.files import atomic_write
from hapticd.servo import faults

REQUIRED = ("code", "cause")
CIRCUMSTANCES = ("time", "config", "config_digest")
"""When the fault was latched (UTC, ISO 8601), and under which configuration."""


def state_directory() -> Path:
    """systemd's ``$STATE_DIRECTORY``, else ``$XDG_STATE_HOME/hapticd``, else ``~/.local/state/hapticd``."""
    if directory := os.environ.get("STATE_DIRECTORY"):
        return Path(directory.split(":")[0])
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local/state") / "hapticd"


def is_service() -> bool:
    """Whether systemd runs the daemon, with a state directory of its own."""
    return bool(os.environ.get("STATE_DIRECTORY"))


def daemon_name(socket: Path) -> str:
    """Name of a daemon for its own files, told apart by the path of its socket."""
    return f"{socket.stem}-{hashlib.sha256(os.fsencode(socket.absolute())).hexdigest()[:8]}"


class FaultLatch:
    """One file for one daemon."""

    def __init__(self, socket: Path) -> None:
        self.name = daemon_name(socket)
        self.path = state_directory() / f"fault-{self.name}.json"

    def load(self) -> dict[str, Any] | None:
        """The fault latched before a restart: ``code``, ``cause``, ``help``, ``number``; None when there is none.

        Beside them ``time``, ``config`` and ``config_digest``, as far as they were written.

        A file that cannot be understood counts as a fault too: it says that something happened.
        """
        try:
            if not self.path.exists():
                return None
            fault = {key: str(value) for key, value in json.loads(self.path.read_text()).items()}
            number = faults.NUMBERS[fault["code"]]
            kept = {key: fault[key] for key in (*REQUIRED, *CIRCUMSTANCES) if key in REQUIRED or key in fault}
            return {**kept, "help": faults.help_of(fault["code"]), "number": number}
        except (ValueError, KeyError, TypeError, AttributeError, OSError):
            cause = f"{self.path} holds a latched fault that cannot be read; look at the machine, then 'hapticd clear'"
            return {"code": "estop", "cause": cause, "help": faults.help_of("estop"), "number": faults.ESTOP}

    @property
    def number(self) -> int:
        """Number of the fault latched before a restart, 0 for none."""
        fault = self.load()
        return fault["number"] if fault else 0

    def store(self, fault: dict[str, Any]) -> None:
        """Write the fault, whole or not at all."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(self.path) as part, part.open("w") as file:
            file.write(json.dumps(fault, indent=1) + "\n")
            file.flush()
            os.fsync(file.fileno())

    def remove(self) -> None:
        """Forget it."""
        self.path.unlink(missing_ok=True)
