"""``hapticd export``: run files for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from hapticd.cli import output
from hapticd.cli.command import command
from hapticd.cli.options import RunArgument


@command(
    "hapticd export @last --to csv",
    "hapticd export run.arrow --to mcap",
    "hapticd export run.arrow --to mat -o wall.mat --force",
)
def export(
    run: RunArgument,
    to: Literal["csv", "parquet", "mat", "mcap"],
    out: Path | None = None,
    force: bool = False,
    salvage: bool = False,
) -> None:
    """Write a recording as csv, parquet, mat or mcap, with the columns and units of the run file.

    An mcap file has one channel, /hapticd/tick, of CDR messages with a ROS 2 definition; config and provenance are in its
    Metadata. PlotJuggler and Foxglove open it without ROS; the answer names a PlotJuggler layout for it. 'hapticd import'
    reads it back.

    A run file that was cut short (power, SIGKILL) is exported up to its last whole batch, with a warning. One whose values
    do not match their checksums is refused without --salvage.

    Args:
        to: Format: csv, parquet, mat (MATLAB 5) or mcap (PlotJuggler, Foxglove).
        out (-o, --output FILE): File to write. Default: RUN with the new suffix.
        force: Replace FILE if it exists.
        salvage: Export what is left of a damaged RUN; its events say what is not.
    """
    from hapticd.client import find_run

    run = find_run(run)
    from hapticd import record

    data = record.read_run(run, salvage=salvage)
    written = record.export(data, to, out, force=force)
    rows = len(next(iter(data.columns.values()), ()))
    if data.truncated:
        output.warn(f"{run} was cut short; exported up to its last whole batch")
    for damage in data.damage:
        output.warn(f"{run} is damaged: {damage} are left out")
    document = {"run": run, "output": written, "format": to, "rows": rows, "truncated": data.truncated}
    text = f"{written}: {rows} rows"
    if to == "mcap":
        from hapticd.record.mcap import LAYOUT

        document["layout"] = LAYOUT
        text += f"\nplotjuggler --layout {LAYOUT} --datafile {written}"
    output.emit(document, text)
