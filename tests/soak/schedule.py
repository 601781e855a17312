"""What happens to the daemons while they are soaked, and when: drawn from a seed, and known before it begins."""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

CALM_S: Final = 15.0
"""Nothing happens so long after the beginning and before the end."""
AFTERMATH_S: Final = 5.0
"""How long after an episode's end a fault may be seen that is of its making: the daemons are looked at every second."""

OF_TIMING: Final = frozenset(
    {"missed_exchanges", "overrun", "heartbeat_lost", "device_fault", "amplifier_dropped", "enable_timeout"}
)
"""What a machine that is late may bring about. A device whose watchdog time has passed reports a fault."""


@dataclass(frozen=True)
class Kind:
    """A kind of episode.

    Attributes:
        every_s: from one to the next, s, on average.
        lasts_s: how long each is, s; 0: an instant.
        explains: codes of the faults that it may bring about. Most may bring about none.
    """

    every_s: float
    lasts_s: float
    explains: frozenset[str] = frozenset()


KINDS: Final[dict[str, Kind]] = {
    "cpu": Kind(120.0, 20.0, OF_TIMING),
    "vm": Kind(120.0, 20.0, OF_TIMING),
    "hdd": Kind(120.0, 20.0, OF_TIMING),
    "disk_full": Kind(600.0, 30.0),
    "clock_step": Kind(300.0, 15.0),
    "deaf_reader": Kind(400.0, 60.0),
    "mute_client": Kind(400.0, 60.0),
    "reload": Kind(180.0, 0.0),
    "bad_reload": Kind(600.0, 0.0),
}
BURSTS: Final = ("cpu", "vm", "hdd")
_TURNS: Final = (BURSTS, *((kind,) for kind in KINDS if kind not in BURSTS))
"""Kinds that take turns: at most one of a row at a time. Those of different rows may meet."""


@dataclass(frozen=True)
class Episode:
    """One of them, from ``begin_s`` to ``end_s`` after the beginning, s."""

    kind: str
    begin_s: float
    end_s: float


def schedule(seconds: float, seed: int) -> list[Episode]:
    """The episodes of a soak of this length, in order; of each kind there is one at least.

    Time is cut into slots. Each holds one episode of the kinds that take turns, wholly and anywhere in it.
    """
    chance = random.Random(seed)
    span = seconds - 2.0 * CALM_S
    episodes = []
    for kinds in _TURNS:
        slots = max(round(span / KINDS[kinds[0]].every_s), len(kinds))
        slot_s = span / slots
        turns: list[str] = []
        for number in range(slots):
            turns = turns or chance.sample(kinds, len(kinds))
            kind = turns.pop()
            lasts_s = min(KINDS[kind].lasts_s, 0.5 * slot_s)
            begin_s = CALM_S + number * slot_s + chance.uniform(0.0, slot_s - lasts_s)
            episodes.append(Episode(kind, begin_s, begin_s + lasts_s))
    return sorted(episodes, key=lambda one: one.begin_s)


def each_came_once_s(episodes: Iterable[Episode]) -> float:
    """When the first episode of every kind was over, s."""
    first: dict[str, float] = {}
    for one in episodes:
        first.setdefault(one.kind, one.end_s)
    return max(first.values(), default=0.0)


def explaining(code: str, seen_s: float, episodes: Iterable[Episode]) -> Episode | None:
    """The episode that may have brought about a fault which was seen then; None: a finding."""
    for one in episodes:
        if code in KINDS[one.kind].explains and one.begin_s <= seen_s <= one.end_s + AFTERMATH_S:
            return one
    return None
