"""``hapticd metrics``: the daemon's numbers for Prometheus, on stdout or as a file for node_exporter."""

from __future__ import annotations

from pathlib import Path

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.options import SocketOption, connect


@command(
    "hapticd metrics",
    "hapticd metrics --testbed left -o /var/lib/prometheus/node-exporter/left.prom",
    codes=(exits.UNREACHABLE,),
)
def metrics(out: Path | None = None, testbed: str | None = None, socket: SocketOption = None) -> int:
    """Show the daemon's metrics in Prometheus' text format.

    Ticks, missed periods, lateness, state, faults, recorder and energies, as the daemon serves them on its socket; and
    hapticd_up. The socket itself is never to be reached over a network: who can read it can start the motor.

    Args:
        out (-o, --output FILE.prom): Replace this file, all at once, for node_exporter's textfile collector. Written
            without a daemon as well, with hapticd_up 0 in it.
        testbed (NAME): Add the label testbed=NAME to every sample, to tell several daemons on one machine apart.
    """
    from hapticd.client import DaemonUnreachable, textfile
    from hapticd.figures.files import write_text

    client = connect(socket)
    try:
        text, up = client.metrics(), True
    except DaemonUnreachable:
        if out is None:
            raise
        text, up = "", False
    text = textfile.labelled(text + textfile.up(up), testbed)
    if out is not None:
        write_text(out, text)
    if output.as_json.get() or out is None:
        output.emit({"up": up, "output": out, "samples": textfile.samples(text)}, text.removesuffix("\n"))
    if not up:
        output.warn(f"no daemon answers on {client.socket_path}; {out} says hapticd_up 0")
        return exits.UNREACHABLE
    return exits.DONE
