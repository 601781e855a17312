"""The theorems at full count: 40,000 exact runs of each kind of loop that they cover, most on the edge of the criterion.

Not one rise of S is allowed. In how many the energy of (35) rises is told beside it. `tests.stability.theorem.draw` says how
loops are drawn.
"""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from typing import Final

from benchmarks.report import Figure, progress, run_alone
from tests.stability.theorem import KINDS, check

COUNT: Final = 40_000
_SEED: Final = 20_060


def measure(quick: bool) -> list[Figure]:
    """Rises of S and broken bounds of speed in each kind of loop; rises of H_T without delay."""
    count = 2_000 if quick else COUNT
    figures = []
    for kind in KINDS:
        begin = time.perf_counter()
        found = check(kind, count, _SEED, periods=400)
        progress(f"{kind}: {found.drawn} runs, {time.perf_counter() - begin:.1f} s")
        peer = f"{found.drawn} runs, {kind}"
        figures.append(Figure("runs in which S rises", found.rising, "", 0.0, "≤", peer, asdict(found)))
        figures.append(Figure("runs beyond their top speed", found.faster, "", 0.0, "≤", peer))
        if kind == "no delay":
            figures.append(
                Figure("runs in which H_T of (35) rises", 100.0 * found.quantised / found.drawn, "%", peer=peer)
            )
    return figures


def main(argv: list[str] | None = None) -> int:
    """Run this benchmark alone."""
    return run_alone("theorem", measure, argv)


if __name__ == "__main__":
    sys.exit(main())
