"""``hapticd verify``: whether a run file is as it was written."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hapticd.cli import exits, output
from hapticd.cli.command import command

if TYPE_CHECKING:
    from hapticd.record.stream import Stream

RunArgument = Annotated[Path, typer.Argument(metavar="RUN", show_default=False, help="Run file (.arrow).")]


@command("hapticd verify run.arrow", "hapticd verify run.arrow --json", codes=(exits.NO,))
def verify(run: RunArgument) -> int:
    """Compare every checksum of a run file, and name the rows that do not match theirs.

    Run files of version 1 have no checksums; that they can be read is all that is said of them.
    """
    from hapticd import record

    verdict = record.verify(run)
    document = {
        "run": run,
        "version": verdict.version,
        "checked": verdict.checked,
        "intact": not verdict.damage_text,
        "rows": verdict.rows,
        "truncated": not verdict.whole,
        "damage": [asdict(part) for part in verdict.damage],
        "metadata_damaged": verdict.metadata_damaged,
    }
    output.emit(document, _text(output.name(run), verdict))
    return exits.NO if verdict.damage_text else exits.DONE


def _text(name: str, verdict: Stream) -> str:
    lines = [f"{name} is damaged: {text}" for text in verdict.damage_text]
    if lines:
        lines.append(f"{verdict.rows} rows are left: 'hapticd export {name} --to parquet --salvage' keeps them")
    elif verdict.checked:
        lines.append(f"{name}: {verdict.rows} rows, all as they were written")
    else:
        without = f"a file of version {verdict.version} has no checksums"
        lines.append(f"{name}: {verdict.rows} rows can be read; {without}")
    if not verdict.whole:
        lines.append("the recording was not ended properly; its rows end with the last whole batch")
    return "\n".join(lines)
