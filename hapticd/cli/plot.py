"""``hapticd plot``: the picture of a run, or of two over each other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hapticd.cli import output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError
from hapticd.cli.options import Duration, ModelOption, RunArgument, check_figure_name, run_argument
from hapticd.cli.output import number

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.record import Run

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
    "hapticd plot @last --bode",
)
def plot(
    run: RunArgument,
    run2: SecondArgument = None,
    out: Path | None = None,
    force: bool = False,
    only: OnlyOption = None,
    duration: Duration | None = None,
    config: ModelOption = None,
    show_bode: bool = False,
    show: bool = False,
) -> None:
    """Draw a run: trace, phase plane, spectrum, energy and lateness; or two, over each other, with their difference.

    Time begins where the spring was rendered. Position is that of the encoder's cell, from the spring's origin; velocity is
    its slope over seven samples; the energy is the ledger of 'hapticd energy', through the model of the run's own config.
    The difference is the second run less the first, at the first one's samples.

    Args:
        out (-o, --output FIG): File to draw into (.png, .svg or .pdf). Default: RUN's name with .png, in this folder.
        force: Replace FIG if it exists.
        duration: Only the first seconds after the spring was rendered.
        show_bode (--bode): Draw the frequency responses of a recorded excitation ('hapticd excite chirp'): of the device,
            and of the impedance that a hand at it feels, with their coherence, beside those of the model, which is simulated
            with the same excitation, and of the linear theory.
        show (--open): Show the figure with the desktop's viewer.
    """
    if unknown := [name for name in only or () if name not in PANELS]:
        raise UsageError(f"--only {unknown[0]}: the panels are {', '.join(PANELS)}")
    if run2 is None and "difference" in (only or ()):
        raise UsageError("--only difference: it needs a second run")
    if show_bode and (run2 is not None or only or duration):
        raise UsageError("--bode is of one whole run: leave RUN2, --only and --duration out")
    check_figure_name(out, force=force)
    from hapticd.client import find_run
    from hapticd.config import load_config
    from hapticd.figures.files import save_figure
    from hapticd.record import read_run
    from hapticd.view import difference, first_seconds, run_figure, signals

    model = load_config(config) if config else None
    if show_bode:
        _plot_bode(read_run(find_run(run)), model, out, force, show)
        return
    paths = [find_run(each) for each in ([run] if run2 is None else [run, run2])]
    target = out or Path(paths[0].with_suffix(".png").name)
    check_figure_name(target, force=force)
    found = []
    for path in paths:
        recorded = read_run(path)
        found.append(signals(first_seconds(recorded, duration) if duration else recorded, model))
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


def _plot_bode(run: Run, model: Config | None, out: Path | None, force: bool, show: bool) -> None:
    from hapticd.figures.files import save_figure
    from hapticd.view.bode import bode
    from hapticd.view.bode_figure import bode_figure

    found = bode(run, model)
    target = out or Path(f"{run.path.stem}-bode.png")
    check_figure_name(target, force=force)
    save_figure(bode_figure(found), target)
    for warning in run.warnings:
        output.warn(warning)
    if found.filled:
        output.warn(f"{found.filled} ticks of it have no row: commands are held over them, places interpolated")
    if found.device.simulated is None:
        output.warn("the model, simulated with this excitation, ends in a fault: the linear theory stands alone")
    document = {"figure": target, "run": run.path, **found.document}
    output.emit(document, describe_bode(document))
    if show:
        typer.launch(str(target))


def describe_bode(document: dict[str, Any]) -> str:
    """A few lines about a frequency response."""
    hz = document["hz"]
    lines = [f"{document['run']}", f"  {number(hz[0])} to {number(hz[-1])} Hz, {len(hz)} frequencies"]
    for key, words in (("device", "device"), ("impedance", "rendered impedance")):
        apart = document[key]["difference"]
        if apart["frequencies"]:
            size, phase = number(apart["magnitude_db"], 2), number(apart["phase_deg"], 2)
            lines.append(f"  {words}: {size} dB and {phase}° RMS from the model, at {apart['frequencies']} frequencies")
        else:
            lines.append(f"  {words}: nowhere coherent enough to compare; a larger --amplitude moves the shaft farther")
    return "\n".join([*lines, f"figure {document['figure']}"])


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
