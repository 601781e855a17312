"""``start``, ``stop``, ``estop``, ``clear``, ``reload``, ``set``, ``origin``: what changes state and settings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.completion import complete_setting
from hapticd.cli.options import ForceOption, SocketOption, connect, guarded, parse_settings
from hapticd.control.endpoints import Endpoints
from hapticd.control.fault_text import fault_lines

ReloadArgument = Annotated[
    str | None,
    typer.Argument(
        metavar="CONFIG",
        show_default=False,
        help="A YAML file or a preset by name. Default: the file that the daemon was started with.",
    ),
]

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
    "hapticd start",
    codes=(exits.NO, exits.UNREACHABLE, exits.DEVICE, exits.FAULT),
    endpoint=Endpoints.start,
)
def _start(force: ForceOption = False, socket: SocketOption = None) -> int:
    return _report(connect(socket).start(force), in_fault=exits.FAULT)


@command("hapticd stop", codes=(exits.UNREACHABLE,), endpoint=Endpoints.stop)
def _stop(socket: SocketOption = None) -> int:
    return _stopped(connect(socket).stop)


@command("hapticd estop", codes=(exits.UNREACHABLE,), endpoint=Endpoints.estop)
def _estop(socket: SocketOption = None) -> int:
    return _stopped(connect(socket).estop)


@command("hapticd clear", codes=(exits.NO, exits.UNREACHABLE), endpoint=Endpoints.clear)
def _clear(socket: SocketOption = None) -> int:
    return _report(connect(socket).clear(), in_fault=exits.NO)


@command(
    "hapticd reload",
    "hapticd reload rig.yaml",
    codes=(exits.NO, exits.UNREACHABLE, exits.DEVICE, exits.FAULT),
    endpoint=Endpoints.reload,
)
def _reload(
    config: ReloadArgument = None,
    force: ForceOption = False,
    socket: SocketOption = None,
) -> int:
    source = str(Path(config).absolute()) if config is not None and Path(config).exists() else config
    return _report(connect(socket).reload(source, force), in_fault=exits.FAULT)


@command(
    "hapticd set spring.stiffness=0.02",
    "hapticd set servo.rate_hz=500 encoder.decimation=217",
    codes=(exits.NO, exits.UNREACHABLE),
    endpoint=Endpoints.set,
)
def _set(
    assignments: AssignmentsArgument,
    force: ForceOption = False,
    socket: SocketOption = None,
) -> None:
    settings = parse_settings(assignments)
    reply = connect(socket).set(settings, force)
    lines = [f"{key} = {output.to_json(value)}" for key, value in reply["applied"].items()]
    output.emit(reply, guarded("\n".join([*lines, f"config {reply['config_digest']}"]), reply))


@command(
    "hapticd origin",
    codes=(exits.NO, exits.UNREACHABLE),
    endpoint=Endpoints.origin,
)
def _origin(force: ForceOption = False, socket: SocketOption = None) -> None:
    reply = connect(socket).origin(force)
    lines = [f"{key} = {output.to_json(value)}" for key, value in reply["applied"].items()]
    output.emit(reply, guarded("\n".join(lines), reply))


def _stopped(halt: Callable[[], dict[str, Any]]) -> int:
    """Stop, and report it; the current is zero, too, where the stop channel alone says so."""
    from hapticd.client import StoppedUnanswered

    try:
        return _report(halt())
    except StoppedUnanswered as stopped:
        output.emit({"state": stopped.state, "unanswered": str(stopped)}, str(stopped))
        return exits.DONE


def _report(status: dict[str, Any], in_fault: int = exits.DONE) -> int:
    fault = status.get("fault")
    lines = [f"{status['state']}: {fault['cause']}", *fault_lines(fault)[1:]] if fault else [status["state"]]
    if unknown := status["position_unknown"]:
        lines.append(unknown)
    output.emit(status, guarded("\n".join(lines), status))
    return in_fault if fault else exits.DONE
