"""``hapticd set``: live settings."""

from __future__ import annotations

from typing import Annotated

import typer

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.completion import complete_setting
from hapticd.cli.options import ForceOption, JsonOption, SocketOption, connect, guarded, parse_settings
from hapticd.control.endpoints import Endpoints

AssignmentsArgument = Annotated[
    list[str],
    typer.Argument(
        metavar="KEY=VALUE",
        show_default=False,
        autocompletion=complete_setting,
        help="Dotted config key and its new value, SI units.",
    ),
]


@command(
    "hapticd set spring.stiffness=0.02",
    "hapticd set servo.rate_hz=500 encoder.decimation=217",
    codes=(exits.DONE, exits.NO, exits.USAGE, exits.UNREACHABLE),
    endpoint=Endpoints.set,
)
def _set(
    assignments: AssignmentsArgument,
    force: ForceOption = False,
    socket: SocketOption = None,
    as_json: JsonOption = False,
) -> int:
    settings = parse_settings(assignments)
    reply = connect(socket).set(settings, force)
    lines = [f"{key} = {output.to_json(value)}" for key, value in reply["applied"].items()]
    output.emit(reply, as_json, guarded("\n".join([*lines, f"config {reply['config_digest']}"]), reply))
    return exits.DONE
