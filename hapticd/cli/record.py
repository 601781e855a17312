"""``hapticd record start|stop``: recordings of every tick."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.options import SocketOption, connect
from hapticd.control.endpoints import Endpoints

RunArgument = Annotated[
    Path | None,
    typer.Argument(
        metavar="RUN", show_default=False, help="File to write (.arrow). Default: a new one in record.directory."
    ),
]


@command(
    "hapticd record start",
    "hapticd record start wall.arrow",
    codes=(exits.NO, exits.UNREACHABLE),
    name="start",
    endpoint=Endpoints.record_start,
)
def _start(run: RunArgument = None, socket: SocketOption = None) -> None:
    _report(connect(socket).record_start(None if run is None else str(run.absolute())))


@command(
    "hapticd record stop --json",
    codes=(exits.NO, exits.UNREACHABLE),
    name="stop",
    endpoint=Endpoints.record_stop,
)
def _stop(socket: SocketOption = None) -> None:
    _report(connect(socket).record_stop())


def _report(recorder: dict[str, Any]) -> None:
    output.emit(recorder, f"{recorder['path']}: {recorder['rows']} rows, {recorder['dropped']} dropped")
