"""The latched fault on disk: it persists over restarts, and only an explicit ``clear`` removes it.

A temporary file is opened in advance. So latching takes one write, one sync and one rename, and no new descriptor, of which
there may be none left at a fault.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from pathlib import Path
from typing import Any

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
    """Name of a daemon for its files, derived from the path of its socket."""
    return f"{socket.stem}-{hashlib.sha256(os.fsencode(socket.absolute())).hexdigest()[:8]}"


class FaultLatch:
    """The file of one daemon.

    Args:
        socket: of the daemon. name: instead of it, `daemon_name`.
    """

    def __init__(self, socket: Path | None = None, *, name: str = "") -> None:
        self.name = daemon_name(socket) if socket is not None else name
        self.path = state_directory() / f"fault-{self.name}.json"
        self._part = self.path.with_name(f".{self.path.name}.{os.getpid()}.part")
        self._descriptor = self._folder = -1

    def load(self) -> dict[str, Any] | None:
        """The fault latched before a restart: ``code``, ``cause``, ``help``, ``number``; None without a fault.

        Also ``time``, ``config`` and ``config_digest``, if they were written.

        An unreadable file counts as a fault.
        """
        try:
            if not self.path.exists():
                return None
            fault = {key: str(value) for key, value in json.loads(self.path.read_text()).items()}
            number = faults.NUMBERS[fault["code"]]
            kept = {key: fault[key] for key in (*REQUIRED, *CIRCUMSTANCES) if key in REQUIRED or key in fault}
            return {**kept, "help": faults.help_of(fault["code"]), "number": number}
        except (ValueError, KeyError, TypeError, AttributeError, OSError, RecursionError):
            cause = f"{self.path} holds a latched fault that cannot be read; look at the machine, then 'hapticd clear'"
            return {"code": "estop", "cause": cause, "help": faults.help_of("estop"), "number": faults.ESTOP}

    @property
    def number(self) -> int:
        """Number of the fault latched before a restart, 0 for none."""
        fault = self.load()
        return fault["number"] if fault else 0

    def prepare(self) -> None:
        """Open the temporary file of `store`, if it is not open yet.

        Raises:
            OSError: the state directory cannot be created or written.
        """
        if self._descriptor >= 0:
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if self._folder < 0:
            for left in self.path.parent.glob(f".{self.path.name}.*.part"):  # of a daemon that was killed
                left.unlink(missing_ok=True)
            self._folder = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        self._descriptor = os.open(self._part, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)

    def store(self, fault: dict[str, Any]) -> None:
        """Write the fault, completely or not at all; after the return it is on disk.

        Raises:
            OSError: it is not on disk.
        """
        data = (json.dumps(fault, indent=1) + "\n").encode()
        self.prepare()
        try:
            self._write(data)
        except OSError:
            # The folder may be removed, with the prepared file in it.
            self.close()
            self.prepare()
            self._write(data)

    def remove(self) -> None:
        """Forget it."""
        self.path.unlink(missing_ok=True)

    def close(self) -> None:
        """Remove the prepared file. Safe to call twice; `prepare` and `store` may follow."""
        for descriptor in (self._descriptor, self._folder):
            if descriptor >= 0:
                with contextlib.suppress(OSError):
                    os.close(descriptor)
        if self._descriptor >= 0:
            with contextlib.suppress(OSError):
                self._part.unlink(missing_ok=True)
        self._descriptor = self._folder = -1

    def _write(self, data: bytes) -> None:
        os.ftruncate(self._descriptor, 0)
        written = 0
        while written < len(data):
            written += os.pwrite(self._descriptor, data[written:], written)
        os.fsync(self._descriptor)
        self._part.rename(self.path)
        descriptor, self._descriptor = self._descriptor, -1
        os.close(descriptor)
        os.fsync(self._folder)
