"""``hapticd record start|stop``: recordings of every tick."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from hapticd.cli import exits, output
from hapticd.cli.options import JsonOption, SocketOption, connect, epilog, register
from hapticd.control.endpoints import Endpoints

RunArgument = Annotated[
    Path | None,
    typer.Argument(
        metavar="RUN", show_default=False, help="File to write (.arrow). Default: a new one in record.directory."
    ),
]


def _start(run: RunArgument = None, socket: SocketOption = None, as_json: JsonOption = False) -> int:
    return _report(connect(socket).record_start(None if run is None else str(run.absolute())), as_json)


def _stop(socket: SocketOption = None, as_json: JsonOption = False) -> int:
    return _report(connect(socket).record_stop(), as_json)


def _report(recorder: dict[str, Any], as_json: bool) -> int:
    output.emit(recorder, as_json, f"{recorder['path']}: {recorder['rows']} rows, {recorder['dropped']} dropped")
    return exits.DONE


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    codes = (exits.DONE, exits.NO, exits.USAGE, exits.UNREACHABLE)
    group = typer.Typer(help="Start and stop recordings.", no_args_is_help=True, rich_markup_mode="rich")
    register(
        group,
        _start,
        "hapticd record start",
        "hapticd record start wall.arrow",
        codes=codes,
        name="start",
        endpoint=Endpoints.record_start,
    )
    register(
        group,
        _stop,
        "hapticd record stop --json",
        codes=codes,
        name="stop",
        endpoint=Endpoints.record_stop,
    )
    app.add_typer(group, name="record", epilog=epilog("hapticd record start", "hapticd record stop", codes=codes))
