"""A few windows that a slip by chance can explain change no verdict; more do, and one that is beyond any slip."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.gap.evidence import few_windows
from hapticd.gap.verdict import Remaining, decide
from hapticd.gap.workflow import _many_far_off


@pytest.mark.parametrize(
    ("remaining", "verdict"),
    [
        (Remaining(1.05, 1.0, False, ()), "effect_found"),
        (Remaining(1.6, 1.0, False, ()), "effect_found"),
        (Remaining(1.6, 1.3, False, ()), "unexplained"),
        (Remaining(1.6, 1.0, True, ()), "unexplained"),
        (Remaining(1.05, 1.0, False, ("speed",)), "unexplained"),
    ],
)
def test_the_verdict_follows_from_what_is_left(remaining: Remaining, verdict: str) -> None:
    assert decide(["gravity"], [()], remaining)[0] == verdict


def test_few_windows_are_four_or_a_share() -> None:
    assert (few_windows(200), few_windows(600), few_windows(2000)) == (4, 4, 14)
    assert (few_windows(100, is_rugged=True), few_windows(600, is_rugged=True)) == (4, 18)


@pytest.mark.parametrize(("far", "times_noise", "many"), [(1, 50.0, False), (3, 50.0, True), (1, 150.0, True)])
def test_slips_by_chance_are_few_and_not_beyond_measure(far: int, times_noise: float, many: bool) -> None:
    square = np.ones(600)
    square[:far] = times_noise**2
    assert _many_far_off(square, few_windows(600)) is many
