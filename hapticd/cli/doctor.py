"""``hapticd doctor``: is this machine fit for the configured rate, and what would make it so."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from hapticd.cli import exits, output
from hapticd.cli.options import ConfigArgument, JsonOption, SettingsOption, register, resolve_config

if TYPE_CHECKING:
    from hapticd.doctor import Examination

_SIGNS = {"good": "ok  ", "note": "note", "bad": "BAD "}


def doctor(config: ConfigArgument = None, assignments: SettingsOption = None, as_json: JsonOption = False) -> int:
    """Say whether this machine is fit to run the servo loop, and how to make it so.

    Looks at the kernel's preemption, real-time limits, CPU frequency and idle states, isolated CPUs and interrupts,
    clock, swap, virtual machine, the disk and compiled-code cache, and the way to the configured device. Each line says
    what was found; where it matters at the configured rate, why, and the command that repairs it. Changes nothing.

    Run it as the user that runs the daemon: limits and permissions are that user's.
    """
    resolved = resolve_config(config, assignments)
    from hapticd.doctor import examine

    found = examine(resolved)
    output.emit(found.document(), as_json, describe(found))
    return exits.DONE if found.fit else exits.NO


def describe(found: Examination) -> str:
    """The report."""
    width = max(len(finding.name) for finding in found.findings)
    lines = []
    for finding in found.findings:
        lines.append(f"{_SIGNS[finding.level.value]}  {finding.name:{width}}  {finding.found}")
        indent = " " * (width + 8)
        if finding.matters:
            lines.append(f"{indent}{finding.matters}")
        if finding.fix:
            lines.append(f"{indent}to repair: {finding.fix}")
    return "\n".join([*lines, "", found.verdict])


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    examples = (
        "hapticd doctor",
        "hapticd doctor /etc/hapticd/hapticd.yaml",
        "hapticd doctor --set servo.rate_hz=3000 --json",
    )
    register(app, doctor, *examples, codes=(exits.DONE, exits.NO, exits.USAGE))
