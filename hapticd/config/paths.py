"""Default paths of the control socket and of run files, from the environment (XDG base directories, systemd)."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

SERVICE_RUNTIME = Path("/run/hapticd")
TEMPORARY = Path("/tmp")  # noqa: S108 - for a folder of each user, see `foreign`
SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - the same


def default_socket() -> str:
    """Control socket: ``$XDG_RUNTIME_DIR/hapticd.sock``, else ``/run/hapticd/`` if writable, else under /tmp."""
    if runtime := _absolute("XDG_RUNTIME_DIR"):
        return str(runtime / "hapticd.sock")
    if os.access(SERVICE_RUNTIME, os.W_OK):
        return str(service_socket())
    return str(_own_folder(TEMPORARY) / "hapticd.sock")


def service_socket() -> Path:
    """Control socket of ``hapticd.service``."""
    return SERVICE_RUNTIME / "hapticd.sock"


def memory_folder() -> Path:
    """This user's folder in ``/dev/shm``."""
    return _own_folder(SHARED_MEMORY)


def foreign(directory: Path) -> str | None:
    """Why this user's folder in ``/tmp`` or ``/dev/shm`` must not be used; None if it may be used.

    Every user may write to the parent, so another user may have created the folder, and could replace files in it.
    """
    if directory not in (_own_folder(TEMPORARY), _own_folder(SHARED_MEMORY)):
        return None
    try:
        found = directory.lstat()
    except FileNotFoundError:
        return None
    if not stat.S_ISDIR(found.st_mode):
        return f"{directory} is not a directory"
    if found.st_uid != os.getuid():
        return f"{directory} belongs to uid {found.st_uid}, not to uid {os.getuid()}: have it removed"
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        mode = stat.S_IMODE(found.st_mode)
        return f"others may write to {directory} (mode {mode:04o}): remove it, or 'chmod go-w {directory}'"
    return None


def _own_folder(place: Path) -> Path:
    return place / f"hapticd-{os.getuid()}"


def service_directory() -> Path:
    """Folder of the run files of ``hapticd.service``."""
    return Path("/var/lib/hapticd/runs")


def find_socket() -> Path:
    """Socket of a running daemon: ``$HAPTICD_SOCKET``, else the user's own, else the service's if it exists."""
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
    """An absolute path from the environment; of several, separated with colons by systemd, the first."""
    path = Path(os.environ.get(variable, "").split(":")[0])
    return path if path.is_absolute() else None
