"""``python -m benchmarks.soak_loaded [--minutes 480]``: three daemons for hours under every kind of load.

Loopback, simulated serial board and simulated CANopen drive run at once at 1 kHz, or as far as this machine carries them,
each with a recording that is begun anew every few minutes. Meanwhile a schedule from a seed is acted out: bursts of
stress-ng, full disks, steps of the wall clock, clients that never read or never speak, reloads, wrong ones too, and
thousands of changed settings. What is judged: each period is done or missed, and told so by recordings and counters alike;
memory, file descriptors and threads stay; each fault has an episode that explains it.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import signal
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from benchmarks.report import BenchmarkError, Figure, document, print_table, progress
from benchmarks.soak import GROWTH_MB, SETTLED_S
from benchmarks.soak_loaded.judge import balance, growth
from benchmarks.soak_loaded.machine import MUCH, Others
from benchmarks.soak_loaded.rigs import DRIVERS, Rig
from benchmarks.soak_loaded.schedule import (
    AFTERMATH_S,
    CALM_S,
    OF_TIMING,
    Episode,
    each_came_once_s,
    explaining,
    schedule,
)
from benchmarks.soak_loaded.troubles import NotDoneError, SmallDisk, Troubles, fresh_settings, stress_ng
from hapticd.hil.clock import JumpingClock
from hapticd.hil.errors import HilError

RATES_HZ: Final = (1000.0, 500.0, 250.0)
_CARRIED: Final = 0.01
"""A rate is carried when no more than this share of the periods, and of the exchanges, is missed without load."""
OTHERS: Final = "other work on the machine"
_ENDING: Final = (signal.SIGINT, signal.SIGTERM)
_LOOK_S: Final = 1.0
_BEAT_S: Final = 0.1
_ROTATE_S: Final = 240.0
_LONGEST_SETTLING_S: Final = 900.0


@dataclass
class Soaked:
    """What was seen of one soak."""

    seconds: float
    asked_s: float
    seed: int
    rigs: list[Rig]
    planned: list[Episode]
    done: list[Episode]
    not_done: list[tuple[Episode, str]]
    interrupted: bool

    @property
    def settled_s(self) -> float:
        """Until then memory may grow: caches fill, code is loaded on first use, and each kind of episode comes once."""
        return max(
            SETTLED_S, min(_LONGEST_SETTLING_S, 0.2 * self.seconds), each_came_once_s(self.planned) + AFTERMATH_S
        )


def carried_rates(seconds: float) -> dict[str, float]:
    """The highest of `RATES_HZ` at which each daemon keeps up while all of them run, without load.

    Raises:
        BenchmarkError: one of them keeps up at none.
    """
    rates = dict.fromkeys(DRIVERS, RATES_HZ[0])
    while True:
        behind = []
        with tempfile.TemporaryDirectory(prefix="hapticd-soak-") as folder, ExitStack() as stack:
            rigs = [stack.enter_context(Rig(name, rate, Path(folder), {})) for name, rate in rates.items()]
            began_s = time.monotonic()
            for rig in rigs:
                rig.begin(began_s)
            before = [rig.client.status() for rig in rigs]
            time.sleep(seconds)
            for rig, then in zip(rigs, before, strict=True):
                share = _missed_share(then, rig.client.status())
                kept = "keeps up" if share <= _CARRIED else "does not keep up"
                progress(f"{rig.name} at {rig.rate_hz:g} Hz: {100 * share:.2f} % missed in {seconds:.0f} s, {kept}")
                if share > _CARRIED:
                    behind.append(rig.name)
        if not behind:
            return rates
        for name in behind:
            slower = [rate for rate in RATES_HZ if rate < rates[name]]
            if not slower:
                raise BenchmarkError(f"{name} does not keep up at {rates[name]:g} Hz: this machine is too slow for it")
            rates[name] = slower[0]


def _missed_share(before: dict[str, Any], after: dict[str, Any]) -> float:
    """Of the periods and exchanges between two looks, whichever is more; all of them after a fault."""
    if after["state"] != "running":
        return 1.0
    done, missed = (after["timing"][key] - before["timing"][key] for key in ("ticks", "missed"))
    exchanges: int = after["exchanges_missed"] - before["exchanges_missed"]
    return float(max(missed / max(1, done + missed), exchanges / max(1, done)))


def soak(seconds: float, rates: dict[str, float], seed: int, settings: int) -> Soaked:
    """Run all of it for so long, or until Ctrl-C.

    Raises:
        BenchmarkError, HilError: it cannot be begun.
    """
    planned = schedule(seconds, seed)
    with tempfile.TemporaryDirectory(prefix="hapticd-soak-") as name, ExitStack() as stack:
        folder = Path(name)
        try:
            clock = JumpingClock(folder)
        except HilError:
            clock = None
        disk = stack.enter_context(SmallDisk(folder / "small"))
        environment = {} if clock is None else clock.environment
        rigs = [stack.enter_context(Rig(name, rate, folder, environment)) for name, rate in rates.items()]
        chance = random.Random(seed + 1)
        troubles = Troubles(planned, rigs, folder, clock, disk, chance)
        began_s = time.monotonic()
        for rig in rigs:
            rig.begin(began_s)
        interrupted = _live(seconds, began_s, rigs, troubles, settings, chance)
        lasted_s = time.monotonic() - began_s
        troubles.end(lasted_s)
        for rig in rigs:
            try:
                rig.end()
            except BenchmarkError as error:
                rig.find(str(error))
        return Soaked(lasted_s, seconds, seed, rigs, planned, troubles.done, troubles.not_done, interrupted)


def _live(
    seconds: float, began_s: float, rigs: Sequence[Rig], troubles: Troubles, settings: int, chance: random.Random
) -> bool:
    """The soak itself: one thread that looks what is due; whether Ctrl-C ended it, between two things that were."""
    looked_s = rotated_s = told_s = 0.0
    changes = 0
    others = Others()
    interrupted = threading.Event()
    for number in _ENDING:
        signal.signal(number, lambda *_: interrupted.set())
    while (now_s := time.monotonic() - began_s) < seconds and not interrupted.is_set():
        troubles.act(now_s)
        alive = [rig for rig in rigs if rig.alive]
        while alive and changes < min(settings, settings * now_s / (seconds - CALM_S)):
            rig = alive[changes % len(alive)]
            rig.set(fresh_settings(chance, rig.config.spring.stiffness))
            changes += 1
        if now_s - looked_s >= _LOOK_S:
            looked_s = now_s
            others.look([os.getpid(), *(process for rig in rigs for process in rig.processes)])
            for rig in alive:
                rig.look(others.share)
                _explain(rig, troubles)
        if now_s - rotated_s >= _ROTATE_S and "disk_full" not in troubles.now:
            rotated_s = now_s
            for rig in alive:
                rig.rotate()
        if now_s - told_s >= 60.0:
            told_s = now_s
            progress(_line(now_s, rigs, troubles, changes))
        time.sleep(_BEAT_S)
    if interrupted.is_set():
        progress("interrupted: what there is, is judged")
    return interrupted.is_set()


def _explain(rig: Rig, troubles: Troubles) -> None:
    fault = rig.open_fault
    if fault is not None and fault.explained_by is None:
        episode = explaining(fault.code, fault.seen_s, troubles.acted())
        if episode is not None:
            fault.explained_by = f"{episode.kind}, begun at {episode.begin_s:.0f} s"
        elif fault.code in OF_TIMING and fault.others >= MUCH:
            fault.explained_by = OTHERS


def _line(now_s: float, rigs: Sequence[Rig], troubles: Troubles, changes: int) -> str:
    words = [f"{now_s / 60:.0f} min", f"{changes} settings", f"now {troubles.now or 'calm'}"]
    for rig in rigs:
        if not rig.alive or not rig.samples:
            words.append(f"{rig.name} is gone")
            continue
        seen, timing = rig.samples[-1], rig.status["timing"]
        words.append(
            f"{rig.name} {rig.status['state']}, {timing['ticks']} ticks, {timing['missed']} missed, "
            f"{len(rig.faults)} faults, {seen.resident / 1e6:.1f} MB, {seen.files} files, {seen.threads} threads"
        )
    return "; ".join(words)


def _of_rig(rig: Rig, soaked: Soaked) -> list[Figure]:
    """Every bound of one daemon, and what has none."""
    name = f"{rig.name} at {rig.rate_hz:g} Hz"
    faults = [fault.details() for fault in rig.faults]
    lost_s = sum((fault.over_s or soaked.seconds) - fault.seen_s for fault in rig.faults)
    unexplained = sum(fault.explained_by is None for fault in rig.faults)
    by_others = sum(fault.explained_by == OTHERS for fault in rig.faults)
    grown = growth(rig.samples, soaked.settled_s)
    known = not math.isnan(grown["resident"])
    samples = [list(asdict(one).values()) for one in rig.samples]
    figures = [
        Figure(
            f"{name}: memory growth once settled",
            grown["resident"],
            "MB",
            GROWTH_MB if known else None,
            details={"settled_s": soaked.settled_s, "s_bytes_files_threads": samples},
        ),
        Figure("resident memory at most", max((one.resident for one in rig.samples), default=0) / 1e6, "MB"),
        Figure("growth of open file descriptors", grown["files"], "", 0.0 if known else None),
        Figure("growth of threads", grown["threads"], "", 0.0 if known else None),
        Figure("faults", len(rig.faults), "", details={"faults": faults}),
        Figure("of them while others loaded the machine", by_others, ""),
        Figure("faults that nothing explains", unexplained, "", 0.0),
        Figure("time lost by faults", lost_s, "s"),
        Figure("other findings", len(rig.findings), "", 0.0, details={"findings": rig.findings}),
        Figure("settings changed", rig.settings, ""),
    ]
    if rig.totals is not None and rig.segments:
        found = balance(rig.segments, rig.totals)
        told = sum(one.settings for one in rig.segments)
        figures += [
            Figure("periods", found["periods"], "", soaked.seconds * rig.rate_hz, "≥", f"{soaked.seconds:.0f} s"),
            Figure("of them on record", found["rows"], "", details={"recordings": len(rig.segments)}),
            Figure("missed, on record, all marked", found["missed"], "", details={"counted": rig.totals.missed}),
            Figure("between recordings", found["between"], ""),
            Figure("missed in a row, at most", found["missed_in_a_row"], ""),
            Figure("exchanges missed", sum(one.exchanges_missed for one in rig.segments), ""),
            Figure("rows dropped", rig.totals.dropped, "", 0.0),
            Figure("periods neither done nor missed", found["unaccounted"], "", 0.0, peer="the daemon's counters"),
            Figure("gaps unmarked, or marks without", found["unmarked"], "", 0.0, peer="the tick column"),
            Figure("ticks that do not rise", found["backwards"], "", 0.0, peer="the tick column"),
            Figure("rows on file, not as counted", found["rows_differ"], "", 0.0, peer="the daemon's counters"),
            Figure("recordings that a full disk ended", rig.ended_by_full_disk, ""),
            Figure("changes of settings on record", told, ""),
        ]
    return [figures[0], *(Figure(**{**vars(one), "name": f"{rig.name}: {one.name}"}) for one in figures[1:])]


def figures(soaked: Soaked) -> list[Figure]:
    """Of every daemon, and of the schedule."""
    done = Counter(episode.kind for episode in soaked.done)
    reasons = sorted({reason for _, reason in soaked.not_done})
    plan: dict[str, Any] = {"seed": soaked.seed, "planned": [asdict(one) for one in soaked.planned]}
    return [
        *(figure for rig in soaked.rigs for figure in _of_rig(rig, soaked)),
        *(Figure(f"episodes: {kind}", count, "") for kind, count in sorted(done.items())),
        Figure("episodes not done", len(soaked.not_done), "", details={**plan, "reasons": reasons}),
    ]


def print_faults(soaked: Soaked) -> None:
    """Each fault with its explanation, and every finding."""
    for rig in soaked.rigs:
        for fault in rig.faults:
            over = "not over" if fault.over_s is None else f"{fault.over_s - fault.seen_s:.0f} s"
            why = fault.explained_by or "NOT EXPLAINED"
            others = f"others {fault.others:.2f} processors"
            print(f"{rig.name}: {fault.seen_s:.0f} s: {fault.code} ({fault.cause}), {others}; {over}; {why}")
        for finding in rig.findings:
            print(f"{rig.name}: FOUND: {finding}")
    for kind, count in sorted(Counter((episode.kind, reason) for episode, reason in soaked.not_done).items()):
        print(f"not done, {count} times: {kind[0]}: {kind[1]}")


def _state(planned: Sequence[Episode], seconds: float, seed: int) -> None:
    """Say what will be done."""
    counts = Counter(episode.kind for episode in planned)
    said = ", ".join(f"{count} {kind}" for kind, count in counts.items())
    progress(f"{seconds / 60:g} min, seed {seed}: {said}")
    for episode in planned:
        progress(f"  {episode.begin_s:7.0f} s to {episode.end_s:7.0f} s  {episode.kind}")


def main() -> int:
    """Soak and print a table; 0, 1 when a bound was broken or the soak could not be made, 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak_loaded", description=__doc__.split("\n\n")[1])
    parser.add_argument("--minutes", type=float, default=480.0, help="how long")
    parser.add_argument("--settings", type=int, default=10_000, help="how many are changed, over all daemons")
    parser.add_argument("--seed", type=int, default=0, help="of the schedule")
    parser.add_argument("--probe-s", type=float, default=120.0, help="how long each rate is tried first")
    parser.add_argument("--json", type=Path, metavar="DIR", default=Path(__file__).parent.parent / "results")
    options = parser.parse_args()
    if not options.minutes > 3.0:
        parser.error("--minutes must be above 3")
    options.json.mkdir(parents=True, exist_ok=True)
    for number in _ENDING:
        signal.signal(number, signal.default_int_handler)
    seconds = options.minutes * 60.0
    try:
        stress_ng()
    except NotDoneError as error:
        progress(f"there will be no bursts: {error}")
    _state(schedule(seconds, options.seed), seconds, options.seed)
    try:
        rates = carried_rates(options.probe_s)
        soaked = soak(seconds, rates, options.seed, options.settings)
        found = document("soak_loaded", figures(soaked), quick=soaked.interrupted)
    except (BenchmarkError, HilError) as error:
        progress(f"soak: {error}")
        return 1
    except KeyboardInterrupt:
        progress("interrupted before there was anything to judge")
        return 130
    path = options.json / "soak_loaded.json"
    path.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")
    print_table([found])
    print_faults(soaked)
    progress(str(path))
    if any(figure["met"] is False for figure in found["figures"]):
        return 1
    return 130 if soaked.interrupted else 0


if __name__ == "__main__":
    sys.exit(main())
