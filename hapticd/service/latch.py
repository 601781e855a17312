"""The latched fault on disk: a fault outlives the daemon, and only an explicit ``clear`` removes it.

Its file is prepared before any fault: open, beside its place. To latch takes one write, one sync and one rename, and no new
descriptor, of which there may be none left by then.
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
    """Name of a daemon for its own files, told apart by the path of its socket."""
    return f"{socket.stem}-{hashlib.sha256(os.fsencode(socket.absolute())).hexdigest()[:8]}"


class FaultLatch:
    """One file for one daemon.

    Args:
        socket: of the daemon. name: in its place, `daemon_name`.
    """

    def __init__(self, socket: Path | None = None, *, name: str = "") -> None:
        self.name = daemon_name(socket) if socket is not None else name
        self.path = state_directory() / f"fault-{self.name}.json"
        self._part = self.path.with_name(f".{self.path.name}.{os.getpid()}.part")
        self._descriptor = self._folder = -1

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
        except (ValueError, KeyError, TypeError, AttributeError, OSError, RecursionError):
            cause = f"{self.path} holds a latched fault that cannot be read; look at the machine, then 'hapticd clear'"
            return {"code": "estop", "cause": cause, "help": faults.help_of("estop"), "number": faults.ESTOP}

    @property
    def number(self) -> int:
        """Number of the fault latched before a restart, 0 for none."""
        fault = self.load()
        return fault["number"] if fault else 0

    def prepare(self) -> None:
        """Open what `store` writes to, if it is not open yet.

        Raises:
            OSError: the state directory cannot be made, or written.
        """
        if self._descriptor >= 0:
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if self._folder < 0:
            for left in self.path.parent.glob(f".{self.path.name}.*.part"):  # by one that was killed
                left.unlink(missing_ok=True)
            self._folder = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        self._descriptor = os.open(self._part, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)

    def store(self, fault: dict[str, Any]) -> None:
        """Write the fault, whole or not at all; it is on disk when this returns.

        Raises:
            OSError: it is not.
        """
        data = (json.dumps(fault, indent=1) + "\n").encode()
        self.prepare()
        try:
            self._write(data)
        except OSError:
            # The folder may have gone, and with it what was prepared in it.
            self.close()
            self.prepare()
            self._write(data)

    def remove(self) -> None:
        """Forget it."""
        self.path.unlink(missing_ok=True)

    def close(self) -> None:
        """Give up what is prepared. Safe to call twice; `prepare` and `store` may follow."""
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
