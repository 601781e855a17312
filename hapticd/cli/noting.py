"""``hapticd note`` and ``marker``: what happened while a recording runs."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.options import SocketOption, connect
from hapticd.control.endpoints import Endpoints

TextArgument = Annotated[
    list[str], typer.Argument(metavar="TEXT", help="What to note; its words may stand without quotes.")
]
NameArgument = Annotated[str, typer.Argument(metavar="NAME", help="Of what happened, such as stimulus_onset.")]
ValueArgument = Annotated[
    str | None, typer.Argument(metavar="[VALUE]", show_default=False, help="A number or text that belongs to it.")
]


@command(
    "hapticd note the operator let go",
    codes=(exits.NO, exits.UNREACHABLE),
    endpoint=Endpoints.note,
)
def _note(text: TextArgument, socket: SocketOption = None) -> None:
    """'hapticd runs' shows it with the recording."""
    _report(connect(socket).note(" ".join(text)))


@command(
    "hapticd marker stimulus_onset",
    "hapticd marker trial 17",
    codes=(exits.NO, exits.UNREACHABLE),
    endpoint=Endpoints.marker,
)
def _marker(name: NameArgument, value: ValueArgument = None, socket: SocketOption = None) -> None:
    from hapticd.config.text import number_or_text

    _report(connect(socket).marker(name, None if value is None else number_or_text(value)))


def _report(noted: dict[str, Any]) -> None:
    output.emit(noted, f"tick {noted['tick']} of {noted['path']}")
