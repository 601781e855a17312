"""``start``, ``stop``, ``estop``, ``clear``, ``reload``: what changes the daemon's state."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from hapticd.cli import exits, output
from hapticd.cli.options import ForceOption, JsonOption, SocketOption, connect, guarded, register

ReloadArgument = Annotated[
    str | None,
    typer.Argument(
        metavar="CONFIG",
        show_default=False,
        help="A YAML file or a preset by name. Default: the file that the daemon was started with.",
    ),
]


def start(force: ForceOption = False, socket: SocketOption = None, as_json: JsonOption = False) -> int:
    """Enable the amplifier and render the spring.

    Refused while a fault is latched: look at 'hapticd status', repair the cause, then 'hapticd clear'. Refused, too,
    where theory says that the motion from where the shaft stands would not die out, with what would help (safety.guard).
    """
    return _report(connect(socket).start(force), as_json, in_fault=exits.FAULT)


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


def reload(
    config: ReloadArgument = None,
    force: ForceOption = False,
    socket: SocketOption = None,
    as_json: JsonOption = False,
) -> int:
    """Read the config anew and put it into force.

    A wrong config is refused and the one in force stays; so is one with which theory sees no motion die out.
    """
    source = str(Path(config).absolute()) if config is not None and Path(config).exists() else config
    return _report(connect(socket).reload(source, force), as_json, in_fault=exits.FAULT)


def _report(status: dict[str, Any], as_json: bool, in_fault: int = exits.DONE) -> int:
    fault = status.get("fault")
    text = f"{status['state']}: {fault['cause']}\nsee {fault['help']}" if fault else str(status["state"])
    output.emit(status, as_json, guarded(text, status))
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
