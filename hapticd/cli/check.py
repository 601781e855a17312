"""``hapticd check``: what the theory says of a config, before anything moves."""

from __future__ import annotations

import shlex
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.completion import complete_config
from hapticd.cli.exits import UsageError
from hapticd.cli.options import Quantity, SettingsOption, check_figure_name, resolve_config

if TYPE_CHECKING:
    from hapticd.stability.devices import Device

SourceArgument = Annotated[
    str | None,
    typer.Argument(
        metavar="CONFIG|DEVICE",
        show_default=False,
        autocompletion=complete_config,
        help="A YAML file, a preset, or a device of the paper's Table II by its name (omega, 'Phantom 1.0', …). "
        "Default: re35, simulated.",
    ),
]

_ANSWERS = {"refused": "refuses to render this without --force", "warned": "renders this with a warning"}


@command(
    "hapticd check rig.yaml",
    "hapticd check --set servo.rate_hz=100 --set encoder.decimation=217 --deflection 10.3 -o plane.png",
    "hapticd check omega --velocity 0.5 --json",
    codes=(exits.NO,),
)
def check(
    source: SourceArgument = None,
    velocity: Quantity | None = None,
    deflection: Quantity | None = None,
    out: Path | None = None,
    force: bool = False,
    assignments: SettingsOption = None,
) -> int:
    """Say what the theory says of a config before anything moves: stable, buzzing or unstable, why, and what would help.

    Names the region of the paper's Fig. 3 (Fig. 5 with a delay) and, where it is not stable, every single change that
    would make it so, each solved for and checked again. Where the speed decides (region D|E), give a velocity or a
    deflection; without one the answer is the speed limit, and counts as done.

    Where the config carries plant.uncertainty, as 'hapticd identify' writes it: the probability that the spring is stable,
    and passive, which parameter decides it, and the stiffness that is stable with 95 %.

    Where no theorem proves that every motion dies out, up to 4,096 starts are simulated exactly, and what became of them
    is told: stable is what all of them come to rest from.

    Exit code 1 means: not stable.

    Args:
        velocity (TICKS_PER_PERIOD): Ask about a motion that passes the spring's origin at this velocity, in coarse
            ticks per servo period; or with a unit: 2rad/s, 90deg/s, 100rpm.
        deflection (TICKS): Ask about a release at rest from this deflection, in coarse ticks from the spring's origin;
            or with a unit: 0.5rad, 30deg, 2mm, 217counts.
        out (-o, --output FIG): Draw the operating point, the critical lines and the regions, and the stiffness and damping
            by frequency that a hand feels, into this file (.png, .svg or .pdf).
        force: Replace FIG if it exists.
    """
    if deflection is not None and velocity is not None:
        raise UsageError("--deflection and --velocity exclude each other: a motion begins at rest or at the origin")
    check_figure_name(out, force=force)
    name, device = _named(source)
    config = resolve_config(name, assignments)
    from hapticd.api.theory import check as ask
    from hapticd.stability.report import report

    try:
        answer = ask(config, velocity=velocity, deflection=deflection)
    except ValueError as error:
        raise UsageError(str(error)) from error
    found, changes, sure = answer.assessment, answer.changes, answer.confidence
    document = answer.document
    if device is not None:
        document["table_ii"] = _table_ii(device)
    title = device.name if device is not None else (source or "re35")
    if out is not None:
        from hapticd.stability.figures.check import check_figure

        if found.loop.stiffness == 0.0:
            raise UsageError("spring.stiffness is 0: there is no operating point to draw")
        check_figure(found, changes, out, title, sure)
        document["figure"] = out
    # a device's own text is about the row as printed; with settings changed it would be about something else
    same = shlex.join(
        [*([source] if source else []), *(part for each in assignments or () for part in ("--set", each))]
    )
    text = report(found, changes, title, None if assignments else device, same)
    if sure is not None:
        unit = "N/m" if config.is_linear else "N m/rad"
        said = f"with plant.uncertainty: {sure.text}"
        if sure.stiffness_max is not None:
            said += f"; stiffness up to {sure.stiffness_max:.3g} {unit} with 95 %"
        text += f"\n\n{textwrap.fill(said, 100)}"
    if guard := _ANSWERS.get(answer.guard.verdict):
        text += f"\n\nsafety.guard: the daemon {guard}"
    # the report has the assessment's own warnings; the driver's doubt about its latency comes after them
    text += "".join(f"\n\nwarning: {doubt}" for doubt in answer.warnings[len(found.warnings) :])
    text += f"\n\nfigure: {out}" if out else ""
    output.emit(document, text)
    return exits.NO if found.verdict in ("buzzes", "unstable", "undecided") else exits.DONE


def _named(source: str | None) -> tuple[str | None, Device | None]:
    """The preset behind a device's name as the paper prints it, and its row; anything else is passed on."""
    if source is None:
        return None, None
    from hapticd.stability.devices import TABLE_II

    wanted = _plain(source)
    for device in TABLE_II:
        if wanted in (_plain(device.name), _plain(device.slug)) and not Path(source).exists():
            return device.slug, device
    return source, None


def _plain(name: str) -> str:
    return "".join(letter for letter in name.lower() if letter.isalnum())


def _table_ii(device: Device) -> list[dict[str, Any]]:
    from dataclasses import asdict

    from hapticd.stability.devices import compare

    return [{**asdict(row), "difference": row.difference} for row in compare(device)]
