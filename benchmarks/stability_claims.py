"""What is called proven, stable or admitted, held against another simulator: fresh configurations of every class.

`tests.stability.claims` draws them, and has the simulator's verdict from many starts of each. ``--json`` lists every false
claim and every refusal.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import asdict
from typing import Final

from benchmarks.report import Figure, progress, run_alone
from tests.stability.claims import CLASSES, Tally, held_against, interval

COUNTS: Final = {"damping": 2000, "B": 2000}
COUNT: Final = 500
STARTS: Final = 10_000
_SEED: Final = 51_000
_PERCENT = 100.0


def _figures(kind: str, found: Tally) -> list[Figure]:
    listed = asdict(found)
    peer = f"{found.drawn} loops, {kind}"

    def share(name: str, false: int, among: int, goal: float | None) -> Figure:
        low, high = interval(false, among) if among else (0.0, 1.0)
        text = f"{false} of {among}, 95 %: {_PERCENT * low:.2g} – {_PERCENT * high:.2g} %; {peer}"
        return Figure(name, _PERCENT * false / max(among, 1), "%", goal, "≤", text)

    return [
        Figure(
            "proven, and a start goes on", found.false_proven, "", 0.0, "≤", f"{found.proven} proven, {peer}", listed
        ),
        share("admitted by exploration, and a start moves on", found.false_explored, found.explored, 0.1),
        share("called stable by exploration, and a start buzzes", found.false_stable, found.stable, None),
        Figure("provable, and refused", found.provable_refused, "", 0.0, "≤", peer),
        share("refused where no start moves on", found.calm_refused, found.calm, 2.0),
    ]


def measure(quick: bool) -> list[Figure]:
    """False claims and needless refusals of each class."""
    figures = []
    jobs = len(os.sched_getaffinity(0))
    for kind in CLASSES:
        count = 20 if quick else COUNTS.get(kind, COUNT)
        begin = time.perf_counter()

        def tell(done: int, kind: str = kind, count: int = count, begin: float = begin) -> None:
            if done % -(-count // 10) == 0:
                progress(f"{kind}: {done} of {count} loops, {time.perf_counter() - begin:.0f} s")

        found = held_against(kind, count, _SEED, 300 if quick else STARTS, jobs=jobs, tell=tell)
        figures += _figures(kind, found)
    return figures


def main(argv: list[str] | None = None) -> int:
    """Run this benchmark alone."""
    return run_alone("stability_claims", measure, argv)


if __name__ == "__main__":
    sys.exit(main())
