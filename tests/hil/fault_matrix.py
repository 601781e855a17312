"""Every fault on every device, again and again: how long until the motor's current is zero, from the device's own log.

``python -m tests.hil.fault_matrix [--trials 20] [--device serial|canopen|firmware] [--only FAULT] [--markdown FILE]``.

A trial counts when the machine was not busy around it. The witnesses are threads of ordinary priority, as the kernel's
carriers of a pseudo-terminal's bytes are, one on each processor, which sleep a millisecond and look how late they wake:
where one was once later than half the time in which a fault must be seen, the trial is none, whatever came of it, and
is repeated. How many is said.

Daemons and devices are forked from a server that has loaded all code, so that a trial takes two seconds in place of
six; where the host's clock jumps they are started as programs, for the library that moves their clock has to be loaded
first.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from hapticd.config import Config, apply_settings, load_config, parse_config
from hapticd.hil.cases import FIRMWARE_CONFIG, FIRMWARE_RATE_HZ, slower_rig
from hapticd.hil.errors import HilError
from hapticd.hil.injections import INJECTIONS, Injection
from hapticd.hil.matrix import SETTLE_S, Row, detection_s, limit_s, run_injection
from tests.forked import fork_what_hil_starts

ROOT = Path(__file__).parents[2]
DEVICES = ("serial", "canopen", "firmware")
_LOOK_S = 1e-3
_BEFORE_S = 0.1
_MOST_REPEATS = 3
"""Trials for each valid one that is asked for, before a fault is given up."""


class Witness:
    """Notes every time at which a thread of ordinary priority woke late, on any processor."""

    def __init__(self) -> None:
        self._late: list[tuple[int, int]] = []
        self._end = threading.Event()
        processors = sorted(os.sched_getaffinity(0))
        self._threads = [threading.Thread(target=self._watch, args=(one,), daemon=True) for one in processors]

    def __enter__(self) -> Witness:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._end.set()
        for thread in self._threads:
            thread.join()

    def _watch(self, processor: int) -> None:
        os.sched_setaffinity(0, {processor})  # of this thread alone
        while not self._end.is_set():
            due = time.monotonic_ns() + round(_LOOK_S * 1e9)
            time.sleep(_LOOK_S)
            late = time.monotonic_ns() - due
            if late > 1e9 * _LOOK_S:
                self._late.append((due, late))

    def latest_s(self, begin_ns: int, end_ns: int) -> float:
        """The most that it was late in a span of time, s."""
        return max((late for due, late in self._late if due + late > begin_ns and due < end_ns), default=0) * 1e-9


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


def markdown(tallies: Sequence[Tally], trials: int) -> str:
    """The table of a device, and in one sentence what goes on."""
    asked = ["git", "describe", "--always", "--dirty"]
    commit = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=False)
    date = time.strftime("%Y-%m-%d", time.gmtime())
    repeated = sum(one.disturbed for one in tallies)
    head = f"Undisturbed trials of each fault: {trials}; commit {commit.stdout.strip() or 'unknown'}, {date}"
    lines = [f"{head}. Disturbed and repeated: {repeated}."]
    stops = [one for one in tallies if not one.goes_on]
    if stops:
        lines += ["", "| " + " | ".join(HEADER) + " |", "|" + "---|" * len(HEADER)]
        lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in one.cells()) + " |" for one in stops]
    if unmoved := [one.injection.what for one in tallies if one.goes_on]:
        lines += ["", f"The loop goes on, or refuses to start, in every trial: {'; '.join(unmoved)}."]
    return "\n".join(lines) + "\n"


def marks(device: str) -> tuple[str, str]:
    """Between which lines of a page the table of a device stands."""
    return (
        f"<!-- table: python -m tests.hil.fault_matrix --device {device} -->",
        f"<!-- end of the table: {device} -->",
    )


def replace_table(page: Path, device: str, text: str) -> None:
    """Put the table of a device between its marks in a page.

    Raises:
        ValueError: the page has no such marks.
    """
    first, last = marks(device)
    whole = page.read_text(encoding="utf-8")
    before, begin, rest = whole.partition(first)
    _, end, after = rest.partition(last)
    if not begin or not end:
        raise ValueError(f"{page} has no lines {first} and {last}")
    page.write_text(f"{before}{begin}\n\n{text}\n{end}{after}", encoding="utf-8")


def main() -> int:
    """Measure what was asked for, print the tables, and write them where asked."""
    parser = argparse.ArgumentParser(prog="python -m tests.hil.fault_matrix", description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=20, metavar="N", help="undisturbed trials of each fault")
    parser.add_argument("--device", action="append", choices=DEVICES, help="repeatable; default: all")
    parser.add_argument("--only", action="append", metavar="FAULT", help="repeatable; 'hapticd hil --json' names them")
    parser.add_argument(
        "--markdown", type=Path, metavar="FILE", help="replace the devices' tables between the marks of this page"
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
                    replace_table(options.markdown, device, markdown(of_device, options.trials))
            tallies += of_device
            if of_device:
                print(f"### {device}\n\n{markdown(of_device, options.trials)}")
    return 0 if all(one.met == len(one.rows) == options.trials for one in tallies) else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
