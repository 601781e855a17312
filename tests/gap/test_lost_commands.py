"""Lost commands are two forces; a model that is less exact where the command changes is not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hapticd.gap.base_model import problem_of
from hapticd.gap.fit import Fit
from hapticd.gap.imitation import imitated
from hapticd.gap.law_set import evidence, scored
from hapticd.gap.lost_commands import mixture_gain
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.terms import term

LOSSES = term("dropped_samples", {"p": 0.2}, (), 0.1)


def lossy(problem: Any) -> tuple[Fit, Fit]:
    """The nominal model, and the same with lost commands."""
    fit = nominal_fit(problem)
    return fit, fit.extended(LOSSES).maximise()


@pytest.fixture(scope="module")
def lost(hidden: Callable[..., Any]) -> tuple[Fit, Fit]:
    recording, model = hidden([{"name": "dropped_samples", "p": 0.2}], 3, 8.0, None)
    return lossy(problem_of([recording], model))


def test_a_fit_without_the_law_has_no_such_gain(lost: tuple[Fit, Fit]) -> None:
    assert not mixture_gain(lost[0]).any()


def test_commands_that_were_lost_have_evidence(lost: tuple[Fit, Fit]) -> None:
    plain, losing = lost
    assert losing.u[-1] == pytest.approx(0.2, rel=0.2)
    assert evidence(scored(losing), scored(plain))[1] > 10.0


@pytest.mark.parametrize("seed", [1, 2])
def test_normal_forces_of_the_same_variance_have_less(lost: tuple[Fit, Fit], seed: int) -> None:
    """The imitation of a fit has a normal force where the fit has a command that may be lost."""
    plain, losing = lossy(imitated(lost[1], seed))
    assert losing.log_likelihood - plain.log_likelihood > 100.0  # for the filter they are lost commands
    assert np.all(np.isfinite(mixture_gain(losing)))
    assert float(mixture_gain(losing).sum()) < -5.0 < 0.0 < float(mixture_gain(lost[1]).sum())
