"""Finds the daemon and recordings, in the same way for the command line and for programs."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from hapticd.client.client import Client, DaemonUnreachable, RequestRefused
from hapticd.config import paths

_LOOK_S = 0.5
"""Longest wait for the daemon's recording folder [s]."""


def recording_folders(socket: str | Path | None = None) -> list[Path]:
    """Folders with recordings: the running daemon's, the user's own, the service's.

    Args:
        socket: the daemon's socket; by default as for `Client`.
    """
    folders = []
    with contextlib.suppress(DaemonUnreachable, RequestRefused, KeyError):
        folders.append(Path(Client(socket, timeout_s=_LOOK_S).config()["record"]["directory"]))
    folders += [Path(paths.default_directory()), paths.service_directory()]
    return list(dict.fromkeys(folders))


def find_run(name: str | os.PathLike[str], socket: str | Path | None = None) -> Path:
    """The file of a run, given as a path, ``@last``, ``@last~1``, or a name in the list of 'hapticd runs'.

    Raises:
        RunFileError: there is no such recording.
    """
    from hapticd.record.listing import resolve_run

    text = os.fspath(name)
    named = text.startswith("@") or (Path(text).name == text and not Path(text).exists())
    return resolve_run(text, recording_folders(socket) if named else [])
