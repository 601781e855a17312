"""A run on the command line: a file, ``@last``, or the name of a recording; and what a shell completes it to."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

HOW = "a file, a name that 'hapticd runs' lists, @last for the newest recording, @last~1 for the one before"
_OFFERED = 20


def complete_run(incomplete: str) -> list[str]:
    """Run files that a word may be meant to be: recordings, the newest first, and run files below what is typed."""
    from hapticd.client import recording_folders
    from hapticd.record.listing import run_paths

    here = Path(incomplete).parent if "/" in incomplete else Path()
    names = ["@last", *(path.name for path in run_paths(recording_folders())[:_OFFERED])]
    files = [str(path) for pattern in ("*.arrow", "*.csv", "*.parquet") for path in sorted(here.glob(pattern))]
    folders = [f"{path}/" for path in sorted(here.iterdir()) if path.is_dir() and not path.name.startswith(".")]
    return [name for name in dict.fromkeys([*names, *files, *folders]) if name.startswith(incomplete)]


def run_argument(what: str, **more: Any) -> Any:
    """The argument RUN of a command; the command takes it through :func:`hapticd.client.find_run`.

    Args:
        what: what the run is, as its help begins. more: further arguments of `typer.Argument`.
    """
    settings = {"metavar": "RUN", "show_default": False, "autocompletion": complete_run, **more}
    return typer.Argument(help=f"{what}: {HOW}.", **settings)


RunArgument = Annotated[Path, run_argument("The run")]
