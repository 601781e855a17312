"""``hapticd recover``: the last seconds of a daemon that was killed, as a run file."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.options import check_folder

FolderArgument = Annotated[
    Path | None,
    typer.Argument(
        metavar="FOLDER",
        show_default=False,
        help="Where flight recorders lie (record.flight_directory). Default: this user's in memory, and the service's.",
    ),
]


@command("hapticd recover", "hapticd recover -o . --json")
def recover(folder: FolderArgument = None, out: Path | None = None) -> None:
    """Keep the last 10 s of every daemon that was killed, each as a run file with the reason if anything tells it.

    A daemon does this by itself for one that died on the same socket before it; a daemon that lives is left alone.

    Args:
        out (-o, --output DIR): Folder for the runs. Default: the dead daemon's own.
    """
    check_folder(out)
    if folder is not None and not folder.is_dir():
        raise exits.UsageError(f"{folder} is no folder")
    from hapticd.config import paths
    from hapticd.record.flight import memory_directory
    from hapticd.service import flight

    folders = [folder] if folder else [memory_directory(), paths.service_socket().parent]
    found = [run for place in dict.fromkeys(folders) if place is not None for run in flight.recover(place, "", out)]
    lines = [f"{output.name(run.run)}: {run.rows} rows\n  {run.reason}" for run in found]
    output.emit({"recovered": [asdict(run) for run in found]}, "\n".join(lines) or "nothing to recover")
