"""``start``, ``stop``, ``estop``, ``clear``, ``reload``: what changes the daemon's state."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from hapticd.cli import exits, output
from hapticd.cli.options import ForceOption, JsonOption, SocketOption, connect, guarded, register
from hapticd.control.endpoints import Endpoints
from hapticd.control.fault_words import fault_lines

ReloadArgument = Annotated[
    str | None,
    typer.Argument(
        metavar="CONFIG",
        show_default=False,
        help="A YAML file or a preset by name. Default: the file that the daemon was started with.",
    ),
]


def _start(force: ForceOption = False, socket: SocketOption = None, as_json: JsonOption = False) -> int:
    return _report(connect(socket).start(force), as_json, in_fault=exits.FAULT)


def _stop(socket: SocketOption = None, as_json: JsonOption = False) -> int:
    return _report(connect(socket).stop(), as_json)


def _estop(socket: SocketOption = None, as_json: JsonOption = False) -> int:
    return _report(connect(socket).estop(), as_json)


def _clear(socket: SocketOption = None, as_json: JsonOption = False) -> int:
    return _report(connect(socket).clear(), as_json, in_fault=exits.NO)


def _reload(
    config: ReloadArgument = None,
    force: ForceOption = False,
    socket: SocketOption = None,
    as_json: JsonOption = False,
) -> int:
    source = str(Path(config).absolute()) if config is not None and Path(config).exists() else config
    return _report(connect(socket).reload(source, force), as_json, in_fault=exits.FAULT)


def _report(status: dict[str, Any], as_json: bool, in_fault: int = exits.DONE) -> int:
    fault = status.get("fault")
    lines = [f"{status['state']}: {fault['cause']}", *fault_lines(fault)[1:]] if fault else [status["state"]]
    if unknown := status["position_unknown"]:
        lines.append(unknown)
    output.emit(status, as_json, guarded("\n".join(lines), status))
    return in_fault if fault else exits.DONE


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    answers = (exits.DONE, exits.USAGE, exits.UNREACHABLE)
    everything = (exits.DONE, exits.NO, exits.USAGE, exits.UNREACHABLE, exits.DEVICE, exits.FAULT)
    register(app, _start, "hapticd start", codes=everything, endpoint=Endpoints.start)
    register(app, _stop, "hapticd stop", codes=answers, endpoint=Endpoints.stop)
    register(app, _estop, "hapticd estop", codes=answers, endpoint=Endpoints.estop)
    register(
        app,
        _clear,
        "hapticd clear",
        codes=(exits.DONE, exits.NO, exits.USAGE, exits.UNREACHABLE),
        endpoint=Endpoints.clear,
    )
    register(
        app,
        _reload,
        "hapticd reload",
        "hapticd reload rig.yaml",
        codes=everything,
        endpoint=Endpoints.reload,
    )
