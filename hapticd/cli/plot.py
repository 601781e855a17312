"""``hapticd plot``: the picture of a run, or of two over each other."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from hapticd.cli import output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError
from hapticd.cli.options import Duration, ModelOption, RunArgument, check_figure_name, run_argument
from hapticd.cli.output import number

PANELS = ("trace", "phase", "spectrum", "energy", "lateness", "difference")

SecondArgument = Annotated[
    Path | None, run_argument("Another run, drawn over it, with their difference", metavar="RUN2")
]
OnlyOption = Annotated[
    list[str] | None,
    typer.Option(
        "--only",
        metavar="NAME",
        show_default=False,
        autocompletion=lambda incomplete: [name for name in PANELS if name.startswith(incomplete)],
        help=f"Only this panel: {', '.join(PANELS)}. Repeatable.",
    ),
]


@command(
    "hapticd plot @last",
    "hapticd plot @last~1 @last -o before-and-after.pdf",
    "hapticd plot run.arrow --only trace --only phase --duration 0.5",
)
def plot(
    run: RunArgument,
    run2: SecondArgument = None,
    out: Path | None = None,
    only: OnlyOption = None,
    duration: Duration | None = None,
    config: ModelOption = None,
    show: bool = False,
) -> None:
    """Draw a run: trace, phase plane, spectrum, energy and lateness; or two, over each other, with their difference.

    Time begins where the spring was rendered. Position is that of the encoder's cell, from the spring's origin; velocity is
    its slope over seven samples; the energy is the ledger of 'hapticd energy', through the model of the run's own config.
    The difference is the second run less the first, at the first one's samples.

    Args:
        out (-o, --output FIG): File to draw into (.png, .svg or .pdf), replaced if it exists. Default: RUN's name with
            .png, in this folder.
        duration: Only the first seconds after the spring was rendered.
        show (--open): Show the figure with the desktop's viewer.
    """
    check_figure_name(out)
    if unknown := [name for name in only or () if name not in PANELS]:
        raise UsageError(f"--only {unknown[0]}: the panels are {', '.join(PANELS)}")
    if run2 is None and "difference" in (only or ()):
        raise UsageError("--only difference: it needs a second run")
    from hapticd.client import find_run
    from hapticd.config import load_config
    from hapticd.figures.files import save_figure
    from hapticd.record import read_run
    from hapticd.view import difference, first_seconds, run_figure, signals

    model = load_config(config) if config else None
    found = []
    for name in [run] if run2 is None else [run, run2]:
        recorded = read_run(find_run(name))
        found.append(signals(first_seconds(recorded, duration) if duration else recorded, model))
    target = out or Path(found[0].run.path.with_suffix(".png").name)
    document: dict[str, Any] = {"figure": target, "runs": [each.document for each in found]}
    if len(found) > 1:
        document["difference"] = difference(found[0], found[1]).document
    save_figure(run_figure(*found, only=only), target)
    for each in found:
        for note in each.notes:
            output.warn(note)
    output.emit(document, describe(document))
    if show:
        typer.launch(str(target))


def describe(document: dict[str, Any]) -> str:
    """A few lines of text about what was drawn."""
    lines = []
    for each in document["runs"]:
        position, speed = each["position"], each["velocity"]
        lines += [
            f"{each['run']}",
            f"  {each['rows']} rows, {number(each['duration_s'])} s at {number(each['rate_hz'])} Hz",
            f"  position {_span(position)}, velocity {_span(speed)}, command {_span(each['command'])}",
        ]
        if each["peak_hz"] is not None:
            lines.append(f"  strongest at {number(each['peak_hz'])} Hz")
        if late := each["lateness"]:
            late_us = ", ".join(f"{name} {number(late[f'{name}_us'], 3)}" for name in ("p50", "p99", "max"))
            lines.append(f"  late {late_us} µs; periods skipped before {late['missed']} ticks")
    if found := document.get("difference"):
        position, command = found["position"], found["command"]
        lines += [
            f"difference over {number(found['duration_s'])} s",
            f"  position RMS {number(position['rms'])}, at most {number(position['max'])} {position['unit']}",
            f"  command RMS {number(command['rms'])}, at most {number(command['max'])} {command['unit']}",
        ]
    return "\n".join([*lines, f"figure {document['figure']}"])


def _span(found: dict[str, Any]) -> str:
    return f"{number(found['min'])} to {number(found['max'])} {found['unit']}"
