"""Default places of the control socket and of run files, from the environment (XDG base directories, systemd)."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

_SERVICE_RUNTIME = Path("/run/hapticd")


def default_socket() -> str:
    """Control socket: ``$XDG_RUNTIME_DIR/hapticd.sock``, else ``/run/hapticd/`` if writable, else under /tmp."""
    if runtime := _absolute("XDG_RUNTIME_DIR"):
        return str(runtime / "hapticd.sock")
    if os.access(_SERVICE_RUNTIME, os.W_OK):
        return str(service_socket())
    return f"/tmp/hapticd-{os.getuid()}/hapticd.sock"


def service_socket() -> Path:
    """Where ``hapticd.service`` listens."""
    return _SERVICE_RUNTIME / "hapticd.sock"


def service_directory() -> Path:
    """Where ``hapticd.service`` records."""
    return Path("/var/lib/hapticd/runs")


def find_socket() -> Path:
    """The socket to look for a daemon on: ``$HAPTICD_SOCKET``, else the user's own, else the service's if it is there."""
    if given := os.environ.get("HAPTICD_SOCKET"):
        return Path(given)
    own, service = Path(default_socket()), service_socket()
    return service if service.exists() and not own.exists() else own


def default_directory() -> str:
    """Run files: ``$STATE_DIRECTORY/runs`` in a service, else ``$XDG_STATE_HOME/hapticd/runs``."""
    if state := _absolute("STATE_DIRECTORY"):
        return str(state / "runs")
    if state := _absolute("XDG_STATE_HOME"):
        return str(state / "hapticd" / "runs")
    home = _absolute("HOME") or Path(tempfile.gettempdir()) / f"hapticd-{os.getuid()}"
    return str(home / ".local" / "state" / "hapticd" / "runs")


def _absolute(variable: str) -> Path | None:
    """An absolute path from the environment; systemd separates several with colons, and the first is the unit's own."""
    path = Path(os.environ.get(variable, "").split(":")[0])
    return path if path.is_absolute() else None
