"""``hapticd set``: live settings."""

from __future__ import annotations

from typing import Annotated

import typer

from hapticd.cli import exits, output
from hapticd.cli.options import ForceOption, JsonOption, SocketOption, connect, guarded, parse_settings, register

AssignmentsArgument = Annotated[
    list[str],
    typer.Argument(metavar="KEY=VALUE", show_default=False, help="Dotted config key and its new value, SI units."),
]


def change(
    assignments: AssignmentsArgument,
    force: ForceOption = False,
    socket: SocketOption = None,
    as_json: JsonOption = False,
) -> int:
    """Change settings while the daemon runs: all of them together between two ticks, or none.

    Live are servo.rate_hz (Hz), servo.overrun.*, spring.* (stiffness in N m/rad or N/m, origin in rad or m),
    encoder.decimation, dither.* (amplitude in coarse ticks or A, frequency_hz), delay.* (s) and safety.*;
    every other key needs a restart. Changes are not written to the config file.

    Settings with which theory sees no motion die out are refused, with what would help (safety.guard); nothing changes.
    """
    settings = parse_settings(assignments)
    reply = connect(socket).set(settings, force)
    lines = [f"{key} = {output.to_json(value)}" for key, value in reply["applied"].items()]
    output.emit(reply, as_json, guarded("\n".join([*lines, f"config {reply['config_digest']}"]), reply))
    return exits.DONE


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    examples = ("hapticd set spring.stiffness=0.02", "hapticd set servo.rate_hz=500 encoder.decimation=217")
    codes = (exits.DONE, exits.NO, exits.USAGE, exits.UNREACHABLE)
    register(app, change, *examples, codes=codes, name="set")
