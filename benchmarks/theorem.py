"""The theorem at full count: 120,000 exact trajectories under each form of the criterion.

Under the corrected and the sharp criterion not one rise of energy is allowed. Under the paper's (12) and (19) rises are
counted, and none of the motions may go on for ever. `tests.stability.theorem.draw` says how trajectories are drawn.
"""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from typing import Final

from benchmarks.report import Figure, progress, run_alone
from hapticd.stability.criterion import Criterion
from tests.stability.theorem import Verdict, check

COUNT: Final = 120_000
_SEED: Final = 20_060
_CRITERIA: Final[tuple[Criterion, ...]] = ("corrected", "sharp", "paper")


def _check(criterion: Criterion, count: int) -> Verdict:
    begin = time.perf_counter()
    verdict = check(criterion, count, _SEED, periods=10_000, fate_periods=5_000_000)
    spent = time.perf_counter() - begin
    progress(f"{criterion}: {verdict.counted} trajectories, {verdict.periods:.3g} periods compared, {spent:.1f} s")
    return verdict


def measure(quick: bool) -> list[Figure]:
    """Rises, broken bounds and fates under the three forms."""
    count = 5_000 if quick else COUNT
    verdicts = {criterion: _check(criterion, count) for criterion in _CRITERIA}
    figures = []
    for criterion, found in verdicts.items():
        peer = f"{found.counted} trajectories, {criterion} criterion"
        details = asdict(found)
        if criterion == "paper":
            share = 100.0 * found.share_rising
            figures.append(Figure("trajectories with a rise of energy", share, "%", peer=peer, details=details))
        else:
            figures.append(Figure("rises of energy", found.rises, "", 0.0, "≤", peer, details))
        lasting = found.persistent + found.growing
        figures.append(Figure("persistent or growing", lasting, "", 0.0, "≤", peer))
        figures.append(Figure("velocity or acceleration bound broken", found.bounds_broken, "", peer=peer))
        figures.append(Figure("still moving, energy falling, after 5e6 periods", found.falling, "", peer=peer))
    return figures


def main(argv: list[str] | None = None) -> int:
    """Run this benchmark alone."""
    return run_alone("theorem", measure, argv)


if __name__ == "__main__":
    sys.exit(main())
