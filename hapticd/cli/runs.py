"""``hapticd runs``: the list of recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hapticd.cli import output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError
from hapticd.cli.options import Count, SocketOption
from hapticd.cli.output import name, number

if TYPE_CHECKING:
    from hapticd.record.listing import Listed

FolderArgument = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="[DIR]...",
        show_default=False,
        help="Folders to list. Default: where the running daemon records, your own recordings, the service's.",
    ),
]


@command("hapticd runs", "hapticd runs /mnt/lab/runs --all --json")
def runs(
    folders: FolderArgument = None,
    limit: Count = 20,
    show_all: bool = False,
    socket: SocketOption = None,
) -> None:
    """List recordings, the newest first: @last, @last~1 and so on, wherever a run is asked for.

    Each with its time, length, rows, size and kind. A recording that was not ended properly (power, SIGKILL, or still being
    written) is marked; it is readable up to its last whole batch. What was kept of the seconds before a fault is listed,
    too, and is no @last.

    Args:
        limit (-n, --number N): How many to list, the newest first.
        show_all (--all): List all of them.
    """
    from hapticd.client import recording_folders
    from hapticd.record.listing import last_runs, listed, run_paths

    for folder in folders or ():
        if not folder.is_dir():
            raise UsageError(f"{folder} is not a folder")
    places = list(folders) if folders else recording_folders(socket)
    paths = run_paths(places)
    found = [listed(path) for path in (paths if show_all else paths[:limit])]
    names = {path: "@last" if at == 0 else f"@last~{at}" for at, path in enumerate(last_runs(paths))}
    shown = [{"name": names.get(each.path), **asdict(each)} for each in found]
    document = {"folders": places, "total": len(paths), "runs": shown}
    output.emit(document, describe(found, names, places, len(paths)))


def describe(found: Sequence[Listed], names: Mapping[Path, str], places: Sequence[Path], total: int) -> str:
    """A line for each recording, under the folder that it is in."""
    if not found:
        return f"no recordings in {' or '.join(map(name, places))}"
    lines = [_line(names.get(each.path, ""), each) for each in found]
    if total > len(found):
        lines.append(f"and {total - len(found)} more; --all lists them")
    several = dict.fromkeys(each.path.parent for each in found)
    return "\n".join([*lines, f"in {' and '.join(map(name, several))}"])


def _line(place: str, each: Listed) -> str:
    when = f"{each.modified.astimezone():%Y-%m-%d %H:%M:%S}"
    if each.error is not None:
        return f"{place:9} {when}  {name(each.path.name)}  ({name(each.error)})"
    length = "-" if each.duration_s is None else f"{number(each.duration_s)} s"
    cut = "" if each.whole else "  (not ended properly, or still being written)"
    return f"{place:9} {when}  {length:>10} {each.rows:>9} rows {_size(each.size):>8}  {name(each.path.name)}{cut}"


def _size(size: int) -> str:
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.0f} kB"
