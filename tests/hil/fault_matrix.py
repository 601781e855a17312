"""Every fault on every device, again and again: how long until the motor's current is zero, from the device's own log.

``python -m tests.hil.fault_matrix [--trials 20] [--device serial|canopen|firmware] [--only FAULT] [--markdown FILE]``.

A trial counts when the machine was not busy around it: where the `Witness` was once later than half the time in which a
fault must be seen, the trial is none, whatever came of it, and is repeated. How many is said.

A page keeps the rows that did not run: each that is of another commit than the table's head says which.

Daemons and devices are forked from a server that has loaded all code, so that a trial takes two seconds in place of
six; where the host's clock jumps they are started as programs, for the library that moves their clock has to be loaded
first.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import wrap

import pytest

from hapticd.config import Config, apply_settings, load_config, parse_config
from hapticd.hil.cases import FIRMWARE_CONFIG, FIRMWARE_RATE_HZ, slower_rig
from hapticd.hil.errors import HilError
from hapticd.hil.injections import INJECTIONS, Injection
from hapticd.hil.matrix import SETTLE_S, Row, detection_s, limit_s, run_injection
from hapticd.hil.witness import Witness
from tests.forked import fork_what_hil_starts

ROOT = Path(__file__).parents[2]
DEVICES = ("serial", "canopen", "firmware")
_BEFORE_S = 0.1
_MOST_REPEATS = 3
"""Trials for each valid one that is asked for, before a fault is given up."""


@dataclass
class Tally:
    """The trials of one fault on one device."""

    device: str
    injection: Injection
    limit_s: float | None
    rows: list[Row] = field(default_factory=list)
    disturbed: int = 0
    refusals: list[str] = field(default_factory=list)
    """Why a trial could not be made."""

    @property
    def zero_s(self) -> list[float]:
        """Times to zero current in order, s."""
        return sorted(row.zero_after_s for row in self.rows if row.zero_after_s is not None)

    @property
    def met(self) -> int:
        """Trials in which everything was as it must be."""
        return sum(row.met for row in self.rows)

    @property
    def goes_on(self) -> bool:
        """Every trial went on, or was refused, as it must: it needs no row of its own."""
        untroubled = self.met == len(self.rows) > 0
        raised = any(row.code for row in self.rows) and not self.injection.refused
        return untroubled and self.limit_s is None and not raised

    def cells(self) -> list[str]:
        """What stands in the table."""
        codes = Counter(row.code or "none" for row in self.rows)
        raised = ", ".join(
            f"`{code}` {count}" if len(codes) > 1 else f"`{code}`" for code, count in codes.most_common()
        )
        zero = self.zero_s
        worst = f"{1e3 * zero[-1]:.2f}" if self.limit_s is not None and zero else ""
        limit = f"{1e3 * self.limit_s:g}" if self.limit_s is not None else "goes on"
        problems = Counter(problem for row in self.rows for problem in row.problems)
        said = "; ".join(f"{count} × {problem}" for problem, count in problems.most_common(2))
        return [
            self.injection.what,
            raised or "; ".join(sorted(set(self.refusals))),
            worst,
            "refused" if self.injection.refused else limit,
            f"{self.met}/{len(self.rows)}" + (f": {said}" if said else ""),
        ]


def _config(device: str) -> Config:
    if device == "firmware":
        config = parse_config(FIRMWARE_CONFIG, "the testbed on the firmware")
        return slower_rig(config, config.servo.rate_hz, FIRMWARE_RATE_HZ)
    name, extra = {
        "serial": ("serial-board", {}),
        "canopen": ("canopen-drive", {"driver.interface": "unix_seqpacket"}),
    }[device]
    config = load_config(str(ROOT / "examples" / f"{name}.yaml"))
    return apply_settings(config, {"servo.rate_hz": "500", **extra}, source="tests.hil.fault_matrix")


@contextmanager
def _forked(injection: Injection) -> Iterator[None]:
    """Fork daemon and device, unless a library has to be loaded before them."""
    with pytest.MonkeyPatch.context() as patch:
        if not injection.clock_jump:
            fork_what_hil_starts(patch)
        yield


def tally(device: str, injection: Injection, trials: int, witness: Witness) -> Tally:
    """Inject one fault until there are ``trials`` undisturbed trials."""
    config = _config(device)
    found = Tally(device, injection, limit_s(config, injection))
    patience = 0.5 * detection_s(config)
    for _ in range(_MOST_REPEATS * trials):
        if len(found.rows) == trials:
            break
        with tempfile.TemporaryDirectory(prefix="hapticd-fault-") as folder, _forked(injection):
            try:
                row = run_injection(config, injection, Path(folder), "mps2-an385" if device == "firmware" else None)
            except HilError as error:
                found.refusals.append(str(error).splitlines()[-1])
                if len(found.refusals) == _MOST_REPEATS:
                    break
                continue
        span = row.struck_ns - round(_BEFORE_S * 1e9), row.struck_ns + round(SETTLE_S * 1e9)
        if row.struck_ns and witness.latest_s(*span) > patience:
            found.disturbed += 1
        else:
            found.rows.append(row)
    return found


HEADER = ("injected", "raised", "worst, ms", "limit, ms", "as it must be")
_GOES_ON = "The loop goes on, or refuses to start, in every trial: "
_OF_COMMIT = re.compile(r" \([0-9a-f]{7,}(-dirty)?\)$")


def markdown(tallies: Sequence[Tally], trials: int, before: str = "") -> str:
    """The table of a device, and in one sentence what goes on.

    Args:
        before: the table until now, whose rows stay where they are not run again; its head stays while there are any.
    """
    asked = ["git", "describe", "--always", "--dirty"]
    said = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=False)
    commit, date = said.stdout.strip() or "unknown", time.strftime("%Y-%m-%d", time.gmtime())
    head, rows, unmoved = _parsed(before)
    for one in tallies:
        rows.pop(one.injection.what, None)
        unmoved.discard(one.injection.what)
    if not rows and not unmoved:
        repeated = sum(one.disturbed for one in tallies)
        head = (
            f"Undisturbed trials of each fault: {trials}; commit {commit}, {date}. Disturbed and repeated: {repeated}."
        )
    for one in tallies:
        if one.goes_on:
            unmoved.add(one.injection.what)
            continue
        what, *cells = (cell.replace("|", "\\|") for cell in one.cells())
        rows[one.injection.what] = [what if f"commit {commit}," in head else f"{what} ({commit})", *cells]
    order = [one.what for one in INJECTIONS]
    lines = [head]
    if kept := [rows[what] for what in order if what in rows]:
        lines += ["", "| " + " | ".join(HEADER) + " |", "|" + "---|" * len(HEADER)]
        lines += ["| " + " | ".join(cells) + " |" for cells in kept]
    if going := [what for what in order if what in unmoved]:
        lines += ["", *wrap(f"{_GOES_ON}{'; '.join(going)}.", 125, break_long_words=False)]
    return "\n".join(lines) + "\n"


def _parsed(table: str) -> tuple[str, dict[str, list[str]], set[str]]:
    """Head, rows by what was injected, and what goes on, of a table that `markdown` has made."""
    head: list[str] = []
    rows: dict[str, list[str]] = {}
    unmoved: set[str] = set()
    for block in table.strip().split("\n\n"):
        if block.startswith("| "):
            for line in block.splitlines()[2:]:
                cells = re.split(r"(?<!\\) \| ", line.removeprefix("| ").removesuffix(" |"))
                rows[_OF_COMMIT.sub("", cells[0])] = cells
        elif block.startswith(_GOES_ON):
            unmoved |= set(" ".join(block.split()).removeprefix(_GOES_ON).removesuffix(".").split("; "))
        else:
            head.append(block)
    return "\n\n".join(head), rows, unmoved


def marks(device: str) -> tuple[str, str]:
    """Between which lines of a page the table of a device stands."""
    return (
        f"<!-- table: python -m tests.hil.fault_matrix --device {device} -->",
        f"<!-- end of the table: {device} -->",
    )


def replace_rows(page: Path, device: str, tallies: Sequence[Tally], trials: int) -> None:
    """Put what was run into the table of a device between its marks in a page.

    Raises:
        ValueError: the page has no such marks.
    """
    first, last = marks(device)
    before, begin, rest = page.read_text(encoding="utf-8").partition(first)
    table, end, after = rest.partition(last)
    if not begin or not end:
        raise ValueError(f"{page} has no lines {first} and {last}")
    page.write_text(f"{before}{begin}\n\n{markdown(tallies, trials, table)}\n{end}{after}", encoding="utf-8")


def main() -> int:
    """Measure what was asked for, print the tables, and write them where asked."""
    parser = argparse.ArgumentParser(prog="python -m tests.hil.fault_matrix", description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=20, metavar="N", help="undisturbed trials of each fault")
    parser.add_argument("--device", action="append", choices=DEVICES, help="repeatable; default: all")
    parser.add_argument("--only", action="append", metavar="FAULT", help="repeatable; 'hapticd hil --json' names them")
    parser.add_argument(
        "--markdown",
        type=Path,
        metavar="FILE",
        help="put what was run into the devices' tables between the marks of this page",
    )
    options = parser.parse_args()
    if unknown := set(options.only or ()) - {one.name for one in INJECTIONS}:
        parser.error(f"no fault is called {', '.join(sorted(unknown))}")
    tallies: list[Tally] = []
    with Witness() as witness:
        for device in options.device or DEVICES:
            driver = _config(device).driver.name
            of_device: list[Tally] = []
            for injection in INJECTIONS:
                if driver not in injection.devices or (options.only and injection.name not in options.only):
                    continue
                of_device.append(tally(device, injection, options.trials, witness))
                print(" | ".join([device, *of_device[-1].cells()]), file=sys.stderr, flush=True)
                if options.markdown:  # an interrupted run leaves what it has
                    replace_rows(options.markdown, device, of_device, options.trials)
            tallies += of_device
            if of_device:
                print(f"### {device}\n\n{markdown(of_device, options.trials)}")
    return 0 if all(one.met == len(one.rows) == options.trials for one in tallies) else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
