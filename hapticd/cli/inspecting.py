"""``hapticd inspect``: what a recording can and cannot tell, before anything is searched in it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from hapticd.cli import output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError
from hapticd.cli.options import RunsArgument
from hapticd.cli.output import number

if TYPE_CHECKING:
    from hapticd.record.inspection import Inspection


@command("hapticd inspect @last", "hapticd inspect before.arrow after.csv --json")
def inspect(runs: RunsArgument = None) -> None:
    """Say what recordings can and cannot tell: stamps, steps, saturation, excitation, rests, closed loop, lateness.

    No model is needed and nothing is fitted: it takes a moment. What a recording cannot tell has its reason beside it, and
    the experiment that would mend most of it is named. 'hapticd gap' and 'hapticd identify' begin with its line.
    """
    if not runs:
        raise UsageError("name a recording: hapticd inspect RUN…")
    from hapticd.client import find_run
    from hapticd.record import read_run
    from hapticd.record.inspection import inspect as look

    found = []
    for name in runs:
        run = read_run(find_run(name))
        for warning in run.warnings:
            output.warn(f"{run.path}: {warning}")
        found.append(look(run))
    document = found[0].document if len(found) == 1 else {"runs": [each.document for each in found]}
    output.emit(document, "\n\n".join(map(_text, found)))


def first_look(paths: Iterable[Path]) -> None:
    """Say of each recording, in a line, what it cannot tell, before anything is searched in it."""
    from hapticd.record import RunFileError, read_run
    from hapticd.record.inspection import inspect as look

    for path in paths:
        with contextlib.suppress(RunFileError):  # what reads it next says why
            output.note(look(read_run(path)).line)


def _text(found: Inspection) -> str:
    from hapticd.config.text import jitter

    stamps, position, excitation = found.stamps, found.position, found.excitation
    grid = f", on a grid of {number(1e3 * stamps['grid_s'])} ms" if stamps["grid_s"] else ""
    band = excitation["command_band_hz"]
    late = f", late by up to {number(1e6 * stamps['late_max_s'])} µs" if stamps["late_max_s"] else ""
    rest, forward = 100 * position["still_share"], 100 * excitation["forward_share"]
    law = 100 * excitation["command_explained_by_motion"]
    swept = f"from {number(band[0], 3)} to {number(band[1], 3)} Hz" if band else "constant"
    lines = [
        found.name,
        f"  stamps      {stamps['rows']} rows, {number(stamps['duration_s'])} s at {number(stamps['rate_hz'], 5)} Hz, "
        f"{jitter(stamps['jitter_s'], 1.0 / stamps['rate_hz'])}{grid}, {stamps['lost_rows']} rows lost{late}",
        f"  position    {number(position['span_cells'])} cells of travel, at rest in {number(rest, 3)} % of the samples",
        f"  command     up to {number(found.current['largest'])}, {found.current['values']} values"
        + (", saturated" if found.current["saturated"] else ""),
        f"  excitation  {excitation['reversals']} reversals, {number(forward, 3)} % forward, command {swept}, "
        f"{number(law, 3)} % of it a law of the motion",
        f"  can tell    {', '.join(found.can_tell) or 'nothing'}",
        *(f"  cannot tell {text}" for text in found.cannot_tell),
    ]
    return "\n".join([*lines, *([f"  next        {found.next_experiment}"] if found.next_experiment else [])])
