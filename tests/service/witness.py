"""A third-party driver that writes every command it gets to ``$WITNESS``: what a device would have seen, kill or no kill."""

from __future__ import annotations

import os

from drivers import PythonDriver


class Witness(PythonDriver):
    """A shaft that stands 100 counts from the origin, so that the spring always asks for a current."""

    summary = "a test's witness"

    def connect(self) -> None:
        """Open the log."""
        self._log = os.open(os.environ["WITNESS"], os.O_WRONLY | os.O_CREAT | os.O_APPEND)

    def disconnect(self) -> None:
        """Say so in the log."""
        os.write(self._log, b"closed\n")

    def read_counts(self) -> int:
        """Always 100."""
        return 100

    def write_current(self, current: float, enable: bool) -> None:
        """One line a command."""
        os.write(self._log, f"{current!r} {int(enable)}\n".encode())
