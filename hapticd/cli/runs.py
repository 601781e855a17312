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

_NOTES_SHOWN = 5
FolderArgument = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="[DIR]...",
        show_default=False,
        help="Folders to list. Default: where the running daemon records, your own recordings, the service's.",
    ),
]


@command(
    "hapticd runs",
    "hapticd runs --where subject=S07 --where 'spring.stiffness>0.01'",
    "hapticd runs /mnt/lab/runs --all --json",
)
def runs(
    folders: FolderArgument = None,
    limit: Count = 20,
    show_all: bool = False,
    where: list[str] | None = None,
    socket: SocketOption = None,
) -> None:
    """List recordings, the newest first: @last, @last~1 and so on, wherever a run is asked for.

    Each with its time, length, rows, size and kind. A recording that was not ended properly (power, SIGKILL, or still being
    written) is marked; it is readable up to its last whole batch. What was kept of the seconds before a fault is listed,
    too, and is no @last. Under a recording stand its notes and markers, with the time since its first row.

    Args:
        where (--where CONDITION): Only recordings for which this holds; repeatable, all have to. KEY=VALUE, or != < <= > >=,
            or ~ (contains). KEY is file, kind, label, subject, condition, sequence, rows, duration_s, size, whole, note, or
            a dotted key of the config that the run was made with, such as spring.stiffness; numbers are in SI units.
        limit (-n, --number N): How many to list, the newest first.
        show_all (--all): List all of them.
    """
    from hapticd.client import recording_folders
    from hapticd.record.listing import last_runs, listed, run_paths
    from hapticd.record.where import ConditionError, choose, read_condition

    try:
        conditions = [read_condition(text) for text in where or ()]
    except ConditionError as error:
        raise UsageError(f"--where {error}") from error

    for folder in folders or ():
        if not folder.is_dir():
            raise UsageError(f"{folder} is not a folder")
    places = list(folders) if folders else recording_folders(socket)
    paths = run_paths(places)
    # a condition is about what stands in the files: all of them are read for it
    met = choose([listed(path) for path in paths], conditions) if conditions else []
    total = len(met) if conditions else len(paths)
    found = met if conditions else [listed(path) for path in (paths if show_all else paths[:limit])]
    found = found if show_all else found[:limit]
    names = {path: "@last" if at == 0 else f"@last~{at}" for at, path in enumerate(last_runs(paths))}
    shown = [{"name": names.get(each.path), **asdict(each)} for each in found]
    document = {"folders": places, "total": total, "runs": shown}
    output.emit(document, describe(found, names, places, total))


def describe(found: Sequence[Listed], names: Mapping[Path, str], places: Sequence[Path], total: int) -> str:
    """A line for each recording, under the folder that it is in."""
    if not found:
        return f"no recordings in {' or '.join(map(name, places))}"
    lines = [line for each in found for line in (_line(names.get(each.path, ""), each), *_note_lines(each))]
    if total > len(found):
        lines.append(f"and {total - len(found)} more; --all lists them")
    several = dict.fromkeys(each.path.parent for each in found)
    return "\n".join([*lines, f"in {' and '.join(map(name, several))}"])


def _line(place: str, each: Listed) -> str:
    when = f"{each.modified.astimezone():%Y-%m-%d %H:%M:%S}"
    if each.error is not None:
        return f"{place:9} {when}  {name(each.path.name)}  ({name(each.error)})"
    length = "-" if each.duration_s is None else f"{number(each.duration_s)} s"
    of = "".join(f"  {key} {name(value)}" for key in ("subject", "condition") if (value := getattr(each, key)))
    cut = "" if each.whole else "  (not ended properly, or still being written)"
    return f"{place:9} {when}  {length:>10} {each.rows:>9} rows {_size(each.size):>8}  {name(each.path.name)}{of}{cut}"


def _note_lines(each: Listed) -> list[str]:
    """A line for each of the first notes and markers."""
    from hapticd.record.where import note_text

    lines = [
        f"{'':9} {'' if note['after_s'] is None else number(note['after_s']) + ' s':>30}  {name(note_text(note))}"
        for note in each.notes[:_NOTES_SHOWN]
    ]
    more = len(each.notes) - _NOTES_SHOWN
    return [*lines, f"{'':42}and {more} more"] if more > 0 else lines


def _size(size: int) -> str:
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.0f} kB"
