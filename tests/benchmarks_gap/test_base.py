"""How well base parameters are fitted where nothing is missing: their errors are from the truth, wherever the fit began."""

from __future__ import annotations

import pytest

from benchmarks.gap.base import fitted
from benchmarks.gap.plan import Case


@pytest.mark.parametrize("seed", [1, 2])
def test_errors_are_from_the_truth(seed: int) -> None:
    found = fitted(Case("none", (), (), seed, 0, "re35", "parquet", 6.0))
    assert [one.name for one in found] == ["inertia", "viscous", "coulomb"]
    assert [one.error for one in found] == pytest.approx([0.0] * 3, abs=0.05)
