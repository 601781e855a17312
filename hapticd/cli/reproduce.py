"""``hapticd reproduce``: every table and figure of the paper, computed here, on one page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError
from hapticd.cli.options import check_folder
from hapticd.cli.output import number


@command(
    "hapticd reproduce -o paper",
    "hapticd reproduce -o look --quick",
    "hapticd reproduce -o fig8 --only fig8 --json",
    codes=(exits.INTERRUPTED,),
)
def reproduce(out: Path, quick: bool = False, only: list[str] | None = None, force: bool = False) -> None:
    """Compute every table and figure of the paper and put them on one page beside its printed numbers.

    Written into DIR: index.html, which holds everything and needs nothing else; each figure as .png and .svg; and
    numbers.json. Fig. 8 is run by the servo loop itself, Fig. 6 and 7 are simulated exactly. Where the paper and this
    code differ, both numbers are shown, with the reason.

    Files appear when all are finished: Ctrl-C leaves DIR as it was.

    Args:
        out (-o, --output DIR): Folder for page, figures and numbers; made if missing.
        quick: Coarser maps and shorter runs, for a first look.
        only (NAME): Only this: table1, table2, fig3 to fig9, fig11 or fig12. Repeatable.
        force: Replace an earlier page in DIR, with its figures.
    """
    from hapticd.reproduce.build import PAGE, names_of_files
    from hapticd.reproduce.build import reproduce as run

    check_folder(out, names_of_files(only or ()), force=force)

    try:
        with output.progress_bar("reproducing") as progress:
            document = run(out, quick=quick, only=only or (), progress=progress)
    except ValueError as error:
        raise UsageError(str(error)) from None
    output.emit({**document, "page": out / PAGE}, describe(document, out / PAGE))


def describe(document: dict[str, Any], page: Path) -> str:
    """What was found, in a few lines."""
    lines = [f"{document['agree']} of {document['comparisons']} printed numbers and statements agree"]
    for row in document["differ"]:
        printed, ours = (value if isinstance(value, str) else number(value) for value in (row["printed"], row["ours"]))
        lines.append(f"  {row['item']:6}  {row['what']}: {printed} there, {ours} here")
    lines.append(f"page    {page}")
    return "\n".join(lines)
