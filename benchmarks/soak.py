"""``make soak [MINUTES=60]``: whether a daemon that runs for long stays as it was, and counts everything it misses.

The daemon runs at 1 kHz in real time as a process of its own, renders, records every row, has its metrics scraped every
second, its status asked for five times a second and its watchdog fed to a stand-in for systemd. Its resident memory is
read every second; the recording is held against its own tick column and against what the daemon counted. How many periods
are missed depends on the machine and has no bound: only that each is counted.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.daemon import MeasuredDaemon
from benchmarks.report import BenchmarkError, Figure, document, print_table, progress
from benchmarks.service_load import Poller, ServicedDaemon
from hapticd.record import Run, read_run
from hapticd.record.schema import FLAG_MISSED_PERIOD

if TYPE_CHECKING:
    from numpy.typing import NDArray

RATE_HZ = 1000.0
SETTLED_S = 60.0
"""Until then memory may grow: caches fill, code is loaded on first use."""
GROWTH_MB = 1.0
STATUS_S = 0.2
_SUMMARY = re.compile(r"^ticks +(\d+), missed periods (\d+).*?^recorded +(\d+) rows, (\d+) dropped", re.M | re.S)


@dataclass(frozen=True)
class Totals:
    """What the daemon says in its last words."""

    ticks: int
    missed: int
    rows: int
    dropped: int

    @classmethod
    def of(cls, words: str) -> Totals:
        """From what it printed.

        Raises:
            BenchmarkError: it ended without them.
        """
        if not (found := _SUMMARY.search(words)):
            raise BenchmarkError(f"the daemon did not end as it should; its last words:\n{words[-2000:]}")
        return cls(*(int(number) for number in found.groups()))


@dataclass
class Soaked:
    """What was seen of one soak: resident memory (time in s, bytes), last words, recording, company."""

    memory: list[tuple[float, int]]
    totals: Totals
    run: Run
    fed: int
    hunger_s: float
    watchdog_s: float
    scrapes: int
    polls: int
    interrupted: bool


def resident_bytes(process: int) -> int:
    """Memory of a process that is in RAM, page by page: the kernel's cheaper figures lag by hundreds of kilobytes."""
    text = Path(f"/proc/{process}/smaps_rollup").read_text()
    found = re.search(r"^Rss: +(\d+) kB", text, re.M)
    assert found is not None
    return int(found[1]) * 1024


def soak(seconds: float) -> Soaked:
    """Run the daemon for so long, or until Ctrl-C.

    Raises:
        BenchmarkError: it cannot be run, or stopped rendering, or somebody was not answered.
    """
    # The two trips that judge how loaded the machine is would end the soak where it is to count; the keep-alives judge the
    # supervisor instead.
    trips = {"servo.overrun.fault_after": "null", "safety.heartbeat_timeout_s": "10"}
    settings = {"servo.rate_hz": str(RATE_HZ), **trips}
    memory: list[tuple[float, int]] = []
    interrupted = False
    with ServicedDaemon(settings) as daemon:
        path = daemon.new_path()
        daemon.client.record_start(path)
        with Poller(daemon.client.status, STATUS_S) as poller:
            try:
                _watch(daemon, seconds, memory)
            except KeyboardInterrupt:
                interrupted = True
                progress("interrupted: what there is, is judged")
        if not interrupted:
            daemon.require_healthy()
            if poller.failed:
                raise BenchmarkError(f"status was not answered: {poller.failed}")
        # The recording goes on to the very last tick, so that it can be held against the daemon's last words.
        totals = Totals.of(daemon.end())
        run = read_run(path)
    return Soaked(
        memory=memory,
        totals=totals,
        run=run,
        fed=daemon.manager.fed,
        hunger_s=daemon.manager.longest_hunger_s,
        watchdog_s=daemon.manager.watchdog_s,
        scrapes=daemon.scraper.answered,
        polls=poller.answered,
        interrupted=interrupted,
    )


def _watch(daemon: MeasuredDaemon, seconds: float, memory: list[tuple[float, int]]) -> None:
    began = time.monotonic()
    while (elapsed := time.monotonic() - began) < seconds:
        memory.append((elapsed, resident_bytes(daemon.pid)))
        if len(memory) % 60 == 0:
            timing = daemon.require_healthy()["timing"]
            progress(
                f"{elapsed / 60:.0f} min: {memory[-1][1] / 1e6:.2f} MB, {timing['ticks']} ticks, {timing['missed']} missed"
            )
        time.sleep(1.0)


def growth_mb(memory: list[tuple[float, int]], settled_s: float = SETTLED_S) -> float:
    """Largest memory after the first minute over that at its end, MB; NaN when the soak was shorter."""
    later = [size for at, size in memory if at >= settled_s]
    return (max(later) - later[0]) / 1e6 if len(later) > 1 else float("nan")


def gaps(tick: NDArray[np.int64], flags: NDArray[np.int64]) -> dict[str, int]:
    """A recording against its own tick column.

    Returns:
        ``periods`` from the first row to the last; ``missed_in_a_row``, the most of them in a row that have none. What must
        be 0: ``unmarked``, gaps whose next row does not say so and rows that say so without one; ``backwards``, places where
        the tick does not rise.
    """
    steps = np.diff(tick)
    marked = (flags[1:] & FLAG_MISSED_PERIOD) != 0
    return {
        "periods": int(tick[-1] - tick[0]) + 1,
        "missed_in_a_row": int(steps.max(initial=1)) - 1,
        "unmarked": int(np.count_nonzero(marked != (steps > 1))),
        "backwards": int(np.count_nonzero(steps < 1)),
    }


def accounts(tick: NDArray[np.int64], flags: NDArray[np.int64], totals: Totals) -> dict[str, int]:
    """The recording against its tick column and against the daemon's counters.

    Returns:
        What `gaps` does; ``missed`` periods, which have no row and were not dropped. What must be 0: ``unaccounted``,
        periods since the daemon's first tick, tick 0, that it counted neither as done nor as missed; ``rows_differ``, rows
        in the file less those that the daemon counted.
    """
    found = gaps(tick, flags)
    return {
        **found,
        "missed": found["periods"] - len(tick) - totals.dropped,
        "unaccounted": int(tick[-1]) + 1 - totals.ticks - totals.missed,
        "rows_differ": len(tick) - totals.rows,
    }


def figures(soaked: Soaked) -> list[Figure]:
    """Every bound of the soak, and what has none."""
    totals = soaked.totals
    found = accounts(soaked.run.columns["tick"], soaked.run.columns["flags"], totals)
    seconds = soaked.memory[-1][0]
    sizes = [size / 1e6 for _, size in soaked.memory]
    memory: dict[str, Any] = {"memory_s_bytes": soaked.memory}
    growth = growth_mb(soaked.memory)
    bound = None if np.isnan(growth) else GROWTH_MB
    return [
        Figure("memory growth after the first minute", growth, "MB", bound, details=memory),
        Figure("resident memory at the end", sizes[-1], "MB"),
        Figure("rows dropped", totals.dropped, "rows", 0.0),
        Figure(
            "periods on the recording", found["periods"], "", seconds * RATE_HZ, "≥", f"{seconds:.0f} s by the clock"
        ),
        Figure("of them missed, all counted", found["missed"], ""),
        Figure("missed in a row, at most", found["missed_in_a_row"], ""),
        Figure("periods neither done nor missed", abs(found["unaccounted"]), "", 0.0, peer="the daemon's counters"),
        Figure("gaps unmarked, or marks without", found["unmarked"], "", 0.0, peer="the tick column"),
        Figure("ticks that do not rise", found["backwards"], "", 0.0, peer="the tick column"),
        Figure("rows on file, not as counted", abs(found["rows_differ"]), "rows", 0.0, peer="the daemon's counters"),
        Figure(
            "longest time between keep-alives", soaked.hunger_s, "s", soaked.watchdog_s, details={"fed": soaked.fed}
        ),
        Figure("metrics scraped", soaked.scrapes, "times"),
        Figure("status asked for", soaked.polls, "times"),
    ]


def draw(soaked: Soaked, path: Path) -> None:
    """Resident memory over time, as PNG."""
    from matplotlib.figure import Figure as Picture

    at, size = np.array(soaked.memory).T
    picture = Picture(figsize=(8, 4), layout="constrained")
    axes = picture.subplots()
    axes.plot(at / 60, size / 1e6)
    settled = size[at >= SETTLED_S]
    if settled.size:
        axes.axhline(settled[0] / 1e6 + GROWTH_MB, color="C3", linestyle="--", label=f"first minute + {GROWTH_MB:g} MB")
        axes.legend()
    axes.set(
        xlabel="time in min", ylabel="resident memory in MB", title=f"hapticd, {soaked.totals.ticks} ticks at 1 kHz"
    )
    picture.savefig(path, dpi=120)


def main() -> int:
    """Soak and print a table; 0, 1 when a bound was broken or the soak could not be made, 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description=__doc__.split("\n\n")[1])
    parser.add_argument("--minutes", type=float, default=60.0, help="how long; memory is judged from the second on")
    parser.add_argument("--json", type=Path, metavar="DIR", default=Path(__file__).parent / "results")
    options = parser.parse_args()
    if not options.minutes > SETTLED_S / 60:
        parser.error("--minutes must be above 1")
    options.json.mkdir(parents=True, exist_ok=True)
    try:
        soaked = soak(options.minutes * 60.0)
        found = document("soak", figures(soaked), quick=soaked.interrupted)
    except BenchmarkError as error:
        progress(f"soak: {error}")
        return 1
    except KeyboardInterrupt:
        progress("interrupted before there was anything to judge")
        return 130
    (options.json / "soak.json").write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")
    draw(soaked, options.json / "soak.png")
    print_table([found])
    progress(f"{options.json / 'soak.json'}, {options.json / 'soak.png'}")
    if any(figure["met"] is False for figure in found["figures"]):
        return 1
    return 130 if soaked.interrupted else 0


if __name__ == "__main__":
    sys.exit(main())
