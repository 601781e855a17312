"""``hapticd doctor``: is this machine fit for the configured rate, and what would make it so; bring-up of a board."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from hapticd.cli import exits, output
from hapticd.cli.command import command
from hapticd.cli.exits import UsageError
from hapticd.cli.options import ConfigArgument, SettingsOption, resolve_config

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.config import Config
    from hapticd.doctor import Examination
    from hapticd.doctor.board import BringUp
    from hapticd.doctor.finding import Finding


_SIGNS = {"good": "ok  ", "note": "note", "bad": "BAD "}


@command(
    "hapticd doctor",
    "hapticd doctor /etc/hapticd/hapticd.yaml",
    "hapticd doctor --set servo.rate_hz=3000 --json",
    "hapticd doctor --device rig.yaml",
    codes=(exits.NO, exits.DEVICE),
)
def doctor(
    config: ConfigArgument = None,
    device: bool = False,
    current: Annotated[float, typer.Option(min=0.0)] | None = None,
    assignments: SettingsOption = None,
) -> int:
    """Say whether this machine is fit to run the servo loop, and how to make it so.

    Looks at the kernel's preemption, real-time limits, CPU frequency and idle states, isolated CPUs and interrupts,
    clock, swap, virtual machine, the disk and compiled-code cache, and the way to the configured device. Each line says
    what was found; where it matters at the configured rate, why, and the command that repairs it. Changes nothing.

    Run it as the user that runs the daemon: limits and permissions are that user's.

    With --device it talks to the serial board itself, the daemon not running: version and capabilities, how fast it
    answers, whether its counter follows the knob and which way. Then, each only after a yes: the watchdog, at zero
    current, and a slow ramp to a small current that shows the polarity. Without a terminal these steps are left out.

    Args:
        device: Bring up the serial board that CONFIG names, step by step, instead of looking at the machine.
        current (A): Peak of --device's ramp, A. Default: 5 % of amplifier.continuous_current.
    """
    resolved = resolve_config(config, assignments)
    if device:
        return _bring_up(resolved, current)
    if current is not None:
        raise UsageError("--current goes with --device")
    from hapticd.doctor import examine

    return _report(examine(resolved))


def _bring_up(config: Config, current: float | None) -> int:
    if config.driver.name != "serial_dac":
        raise UsageError(f"driver.name = {config.driver.name}: --device brings up serial boards, driver serial_dac")
    from hapticd.doctor.board import bring_up, histogram

    found = bring_up(config, Terminal(), current)
    return _report(found, [*histogram(found.round_trip_us), ""])


class Terminal:
    """The person at the terminal; nobody where there is none. Talks on stderr: stdout is the report's."""

    _WIDTH = 30

    def agrees(self, question: str) -> bool:
        """Whether they said yes."""
        return sys.stdin.isatty() and typer.confirm(question, default=False, err=True)

    def does(self, request: str) -> bool:
        """Whether they pressed Enter."""
        if not sys.stdin.isatty():
            return False
        return bool(typer.prompt(f"{request} [Enter, or s to skip]", default="", show_default=False, err=True) != "s")

    def shows(self, counts: int, rate: float, fastest: float) -> None:
        """A bar in place."""
        if sys.stderr.isatty():
            bar = "█" * round(self._WIDTH * min(abs(rate) / max(fastest, 1.0), 1.0))
            text = f"\r{counts:+10d} counts  {bar:{self._WIDTH}} {abs(rate):8.0f} counts/s, at most {fastest:8.0f}"
            print(text, end="", file=sys.stderr, flush=True)


def _report(found: Examination | BringUp, more: Sequence[str] = ()) -> int:
    output.emit(found.document(), "\n".join([*_lines(found.findings), "", *more, found.verdict]))
    return exits.DONE if found.fit else exits.NO


def _lines(findings: Sequence[Finding]) -> list[str]:
    width = max(len(finding.name) for finding in findings)
    lines = []
    for finding in findings:
        lines.append(f"{_SIGNS[finding.level.value]}  {finding.name:{width}}  {finding.found}")
        indent = " " * (width + 8)
        if finding.matters:
            lines.append(f"{indent}{finding.matters}")
        if finding.fix:
            lines.append(f"{indent}to repair: {finding.fix}")
    return lines
