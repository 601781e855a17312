"""``start``, ``stop``, ``estop``, ``clear``, ``reload``: what changes the daemon's state."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from hapticd.cli import exits, output
from hapticd.cli.options import JsonOption, SocketOption, connect, register

ReloadArgument = Annotated[
    str | None,
    typer.Argument(
        metavar="CONFIG",
        show_default=False,
        help="A YAML file or a preset by name. Default: the file that the daemon was started with.",
    ),
]


def start(socket: SocketOption = None, as_json: JsonOption = False) -> int:
    """Enable the amplifier and render the spring.

    Refused while a fault is latched: look at 'hapticd status', repair the cause, then 'hapticd clear'.
    """
    return _report(connect(socket).start(), as_json, in_fault=exits.FAULT)


def stop(socket: SocketOption = None, as_json: JsonOption = False) -> int:
    """Zero current, then disable the amplifier.

    Ends a running experiment. The daemon keeps ticking and can be started again.
    """
    return _report(connect(socket).stop(), as_json)


def estop(socket: SocketOption = None, as_json: JsonOption = False) -> int:
    """Zero current at once, disable the amplifier and latch a fault.

    This is a software stop, not a safety-rated one. 'hapticd clear' releases it.
    """
    return _report(connect(socket).estop(), as_json)


def clear(socket: SocketOption = None, as_json: JsonOption = False) -> int:
    """Clear a latched fault.

    A fault stays latched, also across a restart of the daemon, until it is cleared here.
    """
    return _report(connect(socket).clear(), as_json, in_fault=exits.NO)


def reload(config: ReloadArgument = None, socket: SocketOption = None, as_json: JsonOption = False) -> int:
    """Read the config anew and put it into force.

    A wrong config is refused and the one in force stays.
    """
    source = str(Path(config).absolute()) if config is not None and Path(config).exists() else config
    return _report(connect(socket).reload(source), as_json, in_fault=exits.FAULT)


def _report(status: dict[str, Any], as_json: bool, in_fault: int = exits.DONE) -> int:
    fault = status.get("fault")
    text = f"{status['state']}: {fault['cause']}\nsee {fault['help']}" if fault else str(status["state"])
    output.emit(status, as_json, text)
    return in_fault if fault else exits.DONE


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    answers = (exits.DONE, exits.USAGE, exits.UNREACHABLE)
    everything = (exits.DONE, exits.NO, exits.USAGE, exits.UNREACHABLE, exits.DEVICE, exits.FAULT)
    register(app, start, "hapticd start", codes=everything)
    register(app, stop, "hapticd stop", codes=answers)
    register(app, estop, "hapticd estop", codes=answers)
    register(app, clear, "hapticd clear", codes=(exits.DONE, exits.NO, exits.USAGE, exits.UNREACHABLE))
    register(app, reload, "hapticd reload", "hapticd reload rig.yaml", codes=everything)
