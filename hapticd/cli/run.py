"""``hapticd run``: the daemon in the foreground."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hapticd.cli import exits, output
from hapticd.cli.exits import UsageError
from hapticd.cli.options import ConfigArgument, ForceOption, SettingsOption, SocketOption, register, resolve_config

StartOption = Annotated[
    bool, typer.Option("--start", help="Begin to render at once, without waiting for 'hapticd start'.")
]


def run(
    config: ConfigArgument = None,
    socket: SocketOption = None,
    start: StartOption = False,
    force: ForceOption = False,
    assignments: SettingsOption = None,
) -> int:
    """Run the daemon in the foreground until Ctrl-C.

    Says which device, rate and resolution it uses, what the theory says of the operating point, what real-time rights
    the machine granted, and where its socket and recordings are. Ctrl-C and SIGTERM end with zero current, then disable
    the amplifier, then print a summary.
    """
    if force and not start:
        raise UsageError("--force is for --start: without it nothing is rendered")
    resolved = resolve_config(config, assignments)
    from rich.console import Console

    from hapticd.service.foreground import run_foreground

    # A reload reads the same file wherever the daemon's working directory is by then; a preset has no path.
    source = str(Path(config).absolute()) if config is not None and Path(config).is_file() else config
    console = Console(stderr=True, quiet=output.quiet.get())
    return run_foreground(resolved, source=source, socket=socket, autostart=start, force=force, console=console)


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    examples = (
        "hapticd run",
        "hapticd run rig.yaml --start",
        "hapticd run --set servo.rate_hz=500 --socket /tmp/h.sock",
    )
    register(app, run, *examples, codes=(exits.DONE, exits.USAGE, exits.DEVICE, exits.FAULT))
