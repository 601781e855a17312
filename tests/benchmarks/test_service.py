"""A service's load beside the same without."""

from __future__ import annotations

from benchmarks.report import Figure
from benchmarks.service import compared


def test_each_figure_keeps_its_goal_and_gets_its_ratio() -> None:
    serviced = [Figure("late p50: 3 µs", 1.1, "×", 1.2, peer="cyclictest"), Figure("rows dropped", 2.0, "rows", 0.0)]
    alone = [Figure("late p50: 2 µs", 1.0, "×", 1.2, peer="cyclictest"), Figure("rows dropped", 0.0, "rows", 0.0)]
    late, ratio, dropped = compared("x", serviced, alone)
    assert (late.value, late.goal, late.peer, late.met) == (1.1, 1.2, "cyclictest", True)
    assert (ratio.value, ratio.goal) == (1.1, None)
    assert (dropped.value, dropped.met) == (2.0, False)
