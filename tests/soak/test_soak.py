"""Three daemons for a while under every kind of load: ``MINUTES=480 pytest -m attack -s tests/soak``, or ``make soak``.

Loopback, simulated serial board and simulated CANopen drive run at once, each with a recording that is begun anew every few
minutes. Meanwhile a schedule from a seed is acted out: bursts of stress-ng, full disks, steps of the wall clock, clients
that never read or never speak, reloads, wrong ones too, and many changed settings. Judged: that each period is done
or missed, and told so by recordings and counters alike; that memory, file descriptors and threads stay; that each fault has
an episode that explains it. How many periods are missed depends on the machine and has no bound.
"""

from __future__ import annotations

import os
import random
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path

import pytest

from hapticd.hil.clock import JumpingClock
from hapticd.hil.errors import HilError
from tests.soak.judge import balance, growth
from tests.soak.machine import MUCH, Others
from tests.soak.rigs import Rig
from tests.soak.schedule import AFTERMATH_S, CALM_S, OF_TIMING, each_came_once_s, explaining, schedule
from tests.soak.troubles import SmallDisk, Troubles, fresh_settings

RATES_HZ = {"loopback": 1000.0, "serial": 250.0, "canopen": 250.0}
GROWTH_MB = 1.0
SETTLED_S, LONGEST_SETTLING_S = 60.0, 900.0
"""Until then memory may grow: caches fill, code is loaded on first use, and each kind of episode comes once."""
LOOK_S, BEAT_S, ROTATE_S, TOLD_S = 1.0, 0.1, 240.0, 60.0


@pytest.mark.attack
@pytest.mark.timeout(0)
def test_a_daemon_stays_as_it_was_and_counts_all_that_it_misses(tmp_path: Path) -> None:
    seconds = 60.0 * float(os.environ.get("MINUTES", "4"))
    settings = round(seconds * float(os.environ.get("SETTINGS_PER_S", "0.35")))
    seed = int(os.environ.get("SEED", "0"))
    planned, chance = schedule(seconds, seed), random.Random(seed + 1)
    folder = tmp_path / "s"
    folder.mkdir()
    with ExitStack() as stack:
        try:
            clock = JumpingClock(folder)
        except HilError:
            clock = None
        disk = stack.enter_context(SmallDisk(folder / "small"))
        environment = {} if clock is None else clock.environment
        rigs = [stack.enter_context(Rig(name, rate, folder, environment)) for name, rate in RATES_HZ.items()]
        troubles = Troubles(planned, rigs, folder, clock, disk, chance)
        began_s = time.monotonic()
        for rig in rigs:
            rig.begin(began_s)
        _live(seconds, began_s, rigs, troubles, settings, chance)
        troubles.end(time.monotonic() - began_s)
        for rig in rigs:
            rig.end()
    print(f"episodes: {dict(Counter(one.kind for one in troubles.done))}")
    for kind, reason in sorted({(episode.kind, reason) for episode, reason in troubles.not_done}):
        print(f"not done: {kind}: {reason}")
    latest_s = max(SETTLED_S, min(LONGEST_SETTLING_S, 0.2 * seconds), each_came_once_s(planned) + AFTERMATH_S)
    wrong = [f"{rig.name}: {words}" for rig in rigs for words in _judged(rig, seconds, min(latest_s, 0.5 * seconds))]
    assert not wrong, "\n".join(wrong)


def _live(
    seconds: float, began_s: float, rigs: list[Rig], troubles: Troubles, settings: int, chance: random.Random
) -> None:
    """One thread that looks what is due."""
    looked_s = rotated_s = told_s = 0.0
    changes, others = 0, Others()
    while (now_s := time.monotonic() - began_s) < seconds:
        troubles.act(now_s)
        alive = [rig for rig in rigs if rig.alive]
        while alive and changes < min(settings, settings * now_s / (seconds - CALM_S)):
            rig = alive[changes % len(alive)]
            rig.set(fresh_settings(chance, rig.config.spring.stiffness))
            changes += 1
        if now_s - looked_s >= LOOK_S:
            looked_s = now_s
            others.look([os.getpid(), *(process for rig in rigs for process in rig.processes)])
            for rig in alive:
                rig.look(others.share)
                _explain(rig, troubles)
        if now_s - rotated_s >= ROTATE_S and "disk_full" not in troubles.now:
            rotated_s = now_s
            for rig in alive:
                rig.rotate()
        if now_s - told_s >= TOLD_S:
            told_s = now_s
            states = [f"{rig.name} {rig.status.get('state')}, {len(rig.faults)} faults" for rig in alive]
            print(f"{now_s / 60:.0f} min: {'; '.join(states)}; now {troubles.now or 'calm'}", flush=True)
        time.sleep(BEAT_S)


def _explain(rig: Rig, troubles: Troubles) -> None:
    fault = rig.open_fault
    if fault is not None and fault.explained_by is None:
        episode = explaining(fault.code, fault.seen_s, troubles.acted())
        if episode is not None:
            fault.explained_by = f"{episode.kind}, begun at {episode.begin_s:.0f} s"
        elif fault.code in OF_TIMING and fault.others >= MUCH:
            fault.explained_by = "other work on the machine"


def _judged(rig: Rig, seconds: float, settled_s: float) -> list[str]:
    """What is not as it must be; all that was counted is printed."""
    wrong = list(rig.findings)
    wrong += [
        f"{one.code} at {one.seen_s:.0f} s, unexplained: {one.cause}" for one in rig.faults if not one.explained_by
    ]
    grown = growth(rig.samples, settled_s)
    wrong += [f"growth of {name}: {grown[name]:g}" for name in ("files", "threads") if grown[name] > 0]
    if grown["resident"] > GROWTH_MB:
        wrong.append(f"growth of memory: {grown['resident']:.2f} MB")
    assert rig.totals is not None
    found = balance(rig.segments, rig.totals)
    wrong += [f"{key}: {found[key]}" for key in ("unaccounted", "unmarked", "backwards", "rows_differ") if found[key]]
    if rig.totals.dropped:
        wrong.append(f"{rig.totals.dropped} rows dropped")
    if found["periods"] < seconds * rig.rate_hz:
        wrong.append(f"{found['periods']} periods in {seconds:.0f} s at {rig.rate_hz:g} Hz")
    exchanges = sum(one.exchanges_missed for one in rig.segments)
    print(
        f"{rig.name}: {found}, {exchanges} exchanges missed, {rig.settings} settings, {len(rig.segments)} recordings,"
    )
    print(f"  {rig.ended_by_full_disk} ended by a full disk, {len(rig.faults)} faults, growth {grown}")
    return wrong
