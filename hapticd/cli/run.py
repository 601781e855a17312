"""``hapticd run``: the daemon in the foreground."""

from __future__ import annotations

from pathlib import Path

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError
from hapticd.cli.options import ConfigArgument, ForceOption, SettingsOption, SocketOption, resolve_config


@command(
    "hapticd run",
    "hapticd run rig.yaml --start",
    "hapticd run --set servo.rate_hz=500 --socket /tmp/h.sock",
    codes=(exits.DEVICE, exits.FAULT),
    json=False,
)
def run(
    config: ConfigArgument = None,
    socket: SocketOption = None,
    start: bool = False,
    force: ForceOption = False,
    assignments: SettingsOption = None,
) -> int:
    """Run the daemon in the foreground until Ctrl-C.

    Says which device, rate and resolution it uses, what the theory says of the operating point, what real-time rights
    the machine granted, and where its socket and recordings are. Ctrl-C, SIGTERM, SIGQUIT and a closed terminal end with
    zero current, then disable the amplifier, then print a summary. Ctrl-Z stops the motor and suspends nothing.

    Args:
        start: Begin to render at once, without waiting for 'hapticd start'.
    """
    if force and not start:
        raise UsageError("--force is for --start: without it nothing is rendered")
    resolved = resolve_config(config, assignments)
    from hapticd.service.foreground import run_foreground
    from hapticd.service.sink import Sink

    # Before anything that could have to be stopped: from here on nobody waits for a terminal.
    sink = Sink()
    sink.take_stderr()
    output.last.set(sink.end)
    # A reload reads the same file wherever the daemon's working directory is by then; a preset has no path.
    source = str(Path(config).absolute()) if config is not None and Path(config).is_file() else config
    return run_foreground(
        resolved, sink=sink, source=source, socket=socket, autostart=start, force=force, quiet=output.quiet.get()
    )
