"""A friction law of a speed that the shaft passes between two samples is not fitted."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hapticd.gap.base_model import problem_of
from hapticd.gap.candidates import candidates, scale_of
from hapticd.gap.fit import Fit
from hapticd.gap.missing import moving
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.terms import term


@pytest.fixture(scope="module")
def fit(hidden: Callable[..., Any]) -> Fit:
    recording, model = hidden([{"name": "stribeck", "s": 0.5, "omega_s": 2.0}], 2, 6.0, None)
    return nominal_fit(problem_of([recording], model))


def test_twice_that_speed_leaves_two_samples_a_reversal(fit: Fit) -> None:
    slowest, velocity = scale_of(fit).slowest, fit.out["v"][moving(fit)]
    reversals = np.count_nonzero(np.diff(np.sign(velocity)))
    assert slowest > 0.0
    assert np.count_nonzero(np.abs(velocity) < 2.0 * slowest) == 2 * reversals


def test_no_start_and_no_fit_is_slower(fit: Fit) -> None:
    slowest = scale_of(fit).slowest
    found = candidates(fit, ["stribeck"], 10.0)
    assert found
    for candidate in found:
        (own,) = (k for k, c in enumerate(candidate.term.coordinates) if c.name == "omega_s")
        assert candidate.term.coordinates[own].lower >= math.log(slowest)
        assert candidate.term.start[own] >= math.log(slowest)
    slow = term("stribeck", {"s": 0.1, "omega_s": 0.1 * slowest}, (), 1.0, slowest)
    assert slow.start[1] == slow.coordinates[1].lower == pytest.approx(math.log(slowest))
    assert slow.at_bounds(slow.start) == ["omega_s"]
