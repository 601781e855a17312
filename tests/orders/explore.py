"""The search: every order up to a length, longer ones drawn, and the shortest that breaks a rule."""

from __future__ import annotations

import itertools
import random
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from tests.orders.run import OPERATIONS, Run
from tests.orders.trace import Violation

Script = tuple[str, ...]

EXHAUSTIVE: Final = 4
"""Every order up to this length: 10 + 10² + 10³ + 10⁴."""
LONGEST: Final = 10
_TRIES: Final = 40
"""How often a shorter script is tried, each time with another seed, before it counts as harmless."""


@dataclass(frozen=True)
class Found:
    """A script with a seed that breaks a rule."""

    script: Script
    seed: str
    why: str
    story: str

    def __str__(self) -> str:
        replay = f"python -m tests.orders {self.seed} {' '.join(self.script)}"
        return f"{self.why}\n  again: {replay}\n{self.story}"


def every_order(length: int) -> Iterator[Script]:
    """Every order of so many operations."""
    return itertools.product(OPERATIONS, repeat=length)


def drawn_orders(
    count: int, shortest: int, longest: int, seed: int, operations: Sequence[str] = OPERATIONS
) -> Iterator[Script]:
    """Orders of a drawn length, each operation drawn."""
    draw = random.Random(seed)
    for _ in range(count):
        yield tuple(draw.choices(operations, k=draw.randint(shortest, longest)))


def attempt(script: Sequence[str], seed: str) -> Found | None:
    """Play one script; what it breaks."""
    run = Run(seed)
    try:
        run.play(script)
    except Violation as violation:
        return Found(tuple(script), seed, str(violation), str(run.machine.trace))
    return None


def explore(scripts: Iterable[Script], seed: str) -> tuple[int, Found | None]:
    """Play scripts until one breaks a rule: how many were played, and the shortest script found from that one."""
    count = 0
    for count, script in enumerate(scripts, 1):
        if found := attempt(script, f"{seed}.{count}"):
            return count, shortest(found)
    return count, None


def shortest(found: Found) -> Found:
    """Leave out operations for as long as the same rule breaks with some seed."""
    rule = found.why.partition(":")[0]
    for left_out in range(len(found.script)):
        script = found.script[:left_out] + found.script[left_out + 1 :]
        for seed in (found.seed, *(f"{found.seed}.{number}" for number in range(_TRIES))):
            shorter = attempt(script, seed)
            if shorter is not None and shorter.why.partition(":")[0] == rule:
                return shortest(shorter)
    return found
