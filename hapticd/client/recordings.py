"""Where the daemon is, and where recordings are: the same answer for the command line and for programs."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from hapticd.client.client import Client, DaemonUnreachable, RequestRefused
from hapticd.config import paths

_LOOK_S = 0.5
"""How long a daemon may take to say where it records; it is only asked on the way to something else."""


def recording_folders(socket: str | Path | None = None) -> list[Path]:
    """Folders in which recordings are looked for: the running daemon's, the user's own, the service's.

    Args:
        socket: the daemon's socket; found as `Client` finds it by default.
    """
    folders = []
    with contextlib.suppress(DaemonUnreachable, RequestRefused, KeyError):
        folders.append(Path(Client(socket, timeout_s=_LOOK_S).config()["record"]["directory"]))
    folders += [Path(paths.default_directory()), paths.service_directory()]
    return list(dict.fromkeys(folders))


def find_run(name: str | os.PathLike[str], socket: str | Path | None = None) -> Path:
    """The file that a run's name stands for: a path, ``@last``, ``@last~1``, or a name that 'hapticd runs' lists.

    Raises:
        RunFileError: there is no such recording.
    """
    from hapticd.record.listing import resolve_run

    text = os.fspath(name)
    named = text.startswith("@") or (Path(text).name == text and not Path(text).exists())
    return resolve_run(text, recording_folders(socket) if named else [])
