"""``hapticd status``: what the daemon is doing, once or again and again."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError
from hapticd.cli.options import Duration, SocketOption, connect
from hapticd.cli.output import number
from hapticd.control.endpoints import Endpoints
from hapticd.control.fault_text import fault_lines

if TYPE_CHECKING:
    from hapticd.client import Client


@command(
    "hapticd status",
    "hapticd status --watch --interval 1",
    "hapticd status --json | jq .timing.wake_us",
    codes=(exits.NO, exits.UNREACHABLE, exits.INTERRUPTED),
    endpoint=Endpoints.status,
)
def _status(watch: bool = False, interval: Duration = 0.5, socket: SocketOption = None) -> int:
    """The exit code is 1 while a fault is latched.

    Args:
        watch: Show it again and again until Ctrl-C.
        interval (S): Time between two looks with --watch, s.
    """
    if watch and output.as_json.get():
        raise UsageError("--watch is for people; for a program, call 'hapticd status --json' again and again")
    client = connect(socket)
    if watch:
        _watch(client, interval)
    report = client.status()
    output.emit(report, describe(report, client.socket_path))
    return exits.NO if report["state"] == "fault" else exits.DONE


def describe(report: dict[str, Any], socket: Path) -> str:
    """One screen of text about one status.

    Args:
        report: the daemon's status.
        socket: where it was asked.
    """
    timing, point, units = report["timing"], report["operating_point"], report["units"]
    rows = [("state", f"{report['state']}    config {report['config_digest']}    {socket}")]
    if fault := report.get("fault"):
        first, *others = fault_lines(fault)
        rows += [("fault", first), *(("", line) for line in others)]
    rows += [
        ("loop", f"{number(timing['rate_hz'])} Hz: {timing['last_10_s']['verdict']}"),
        *_paces(timing),
        (
            "operating at",
            f"μ {_number(point['mu'])}   β {_number(point['beta'])}   σ {_number(point['sigma'])}   "
            f"τ_D {_number(point['tau_d'])}   region {point['region'] or '-'}",
        ),
        (
            "shaft",
            f"{number(report['position'])} {units['position']} = {number(report['position_ticks'])} ticks   "
            f"{number(report['velocity'])} {units['velocity']}   {number(report['current'])} {units['current']}",
        ),
        ("energy", _energy(report["energy"])),
        ("recording", _recorder(report["recorder"])),
    ]
    if (enable := report["enable"])["required"]:
        rows.insert(1, ("enable", "held" if enable["held"] else "released: hold it, or nothing starts"))
    if unknown := report["position_unknown"]:
        rows.insert(-2, ("", unknown))
    if (passivity := report["passivity"])["mode"] != "off":
        rows.insert(-1, ("passivity", _passivity(passivity)))
    rows += [("attention", _attention(entry)) for entry in report.get("self_check", ()) if not entry["ok"]]
    if off := report["limits_off"]:
        from hapticd.config.limits import limits_text

        rows.insert(-2, ("limits", limits_text(off)))
    if lost := report["log_lines_dropped"]:
        rows.append(("log", f"{lost} lines lost: nobody read them in time"))
    experiment = report.get("experiment") or {"state": "idle"}
    if experiment["state"] != "idle":
        rows.append(
            ("experiment", f"{experiment['kind']}: {experiment['state']}, {100 * experiment['progress']:.0f} %")
        )
    return "\n".join(f"{name:14}{value}" for name, value in rows)


def _paces(timing: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """The last seconds, the last minute, and everything since the start."""
    for name, pace in (("last 10 s", timing["last_10_s"]), ("last 60 s", timing["last_60_s"]), ("since start", timing)):
        yield (
            name,
            f"{pace['ticks']} ticks, {pace['missed']} periods and {pace['exchanges_missed']} exchanges missed",
        )
        yield ("  woke late", _percentiles(pace["wake_us"]))
        yield ("  ran for", _percentiles(pace["exec_us"]))


def _number(value: Any) -> str:
    """A dimensionless number; a status document has null for infinity, which is what everything is without a spring."""
    return "∞" if value is None else number(value)


def _energy(energy: dict[str, Any]) -> str:
    parts = (f"{name} {number(energy[f'{name}_J'])} J" for name in ("stored", "dissipated", "generated"))
    return f"{'   '.join(parts)}   ({energy['estimate']}, since the start)"


def _passivity(passivity: dict[str, Any]) -> str:
    parts = (f"{name.replace('_', ' ')} {number(passivity[f'{name}_J'])} J" for name in ("put_out", "generated"))
    text = f"{'   '.join(parts)}   (observed, since the start)"
    if passivity["mode"] == "control":
        text += f"   dissipated {number(passivity['dissipated_J'])} J   adds {number(passivity['current'])} A"
    return text


def _percentiles(found: dict[str, Any]) -> str:
    return "   ".join(
        f"{label} {number(found[key])} µs"
        for label, key in (("p50", "p50"), ("p99", "p99"), ("p99.9", "p999"), ("max", "max"))
    )


def _recorder(recorder: dict[str, Any]) -> str:
    if error := recorder.get("error"):
        return f"stopped: {output.name(error)}"
    if not recorder["path"]:
        return "off"
    return f"{output.name(recorder['path'])}, {recorder['rows']} rows, {recorder['dropped']} dropped"


def _attention(entry: dict[str, Any]) -> str:
    """What the daemon has found of itself and not mended."""
    return f"{entry['found']}; {entry['done']}" if entry["done"] else entry["found"]


def _watch(client: Client, interval: float) -> None:
    """Redraw until Ctrl-C; in a pipe, one block a look."""
    if not sys.stdout.isatty():
        while True:
            print(output.printable(describe(client.status(), client.socket_path)), end="\n\n", flush=True)
            time.sleep(interval)
    from rich.live import Live
    from rich.text import Text

    with Live(auto_refresh=False) as live:
        while True:
            live.update(Text(output.printable(describe(client.status(), client.socket_path))), refresh=True)
            time.sleep(interval)
