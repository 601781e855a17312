"""Imitations of a recording: what a model makes itself along the same path."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from benchmarks.gap.disturbance import Coloured
from hapticd.gap.base_model import problem_of
from hapticd.gap.covariance import covariance_of
from hapticd.gap.fit import Fit
from hapticd.gap.imitation import imitated
from hapticd.gap.kernel.ticks import CORRELATION, DISTURBANCE, JITTER
from hapticd.gap.missing import moving
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.terms import term

Hidden = Callable[..., Any]
SECONDS = 6.0


@pytest.fixture(scope="module")
def shaken(hidden: Hidden) -> Fit:
    """The nominal model on a device that has nothing but a strong torque of 10 ms."""
    recording, model = hidden([], 11, SECONDS, Coloured(0.25, 0.01))
    return nominal_fit(problem_of([recording], model))


def test_an_imitation_stays_near_the_recorded_path(shaken: Fit) -> None:
    series, made = shaken.problem.series, imitated(shaken, 1).series
    off = (made.cell - series.cell) * series.resolution
    assert 0.0 < np.sqrt(np.mean(off**2)) < 0.05 * np.ptp(shaken.out["x"])
    assert made.cell - series.cell == pytest.approx(np.rint(made.cell - series.cell), abs=1e-6), (
        "cells of the same encoder"
    )
    assert np.array_equal(imitated(shaken, 1).series.cell, made.cell)
    assert not np.array_equal(imitated(shaken, 2).series.cell, made.cell)


def test_an_imitation_is_as_noisy_as_its_model_says(shaken: Fit) -> None:
    """With jitter and lost commands, whose variances add up with the others'."""
    u = shaken.u.copy()
    u[JITTER] = np.log(0.2 * shaken.problem.series.period_s)
    losing = Fit(shaken.problem, (term("dropped_samples", {"p": 0.2}, (), 0.1),), np.append(u, 0.2))
    problem = imitated(losing, 3)
    out = Fit(problem, losing.terms, losing.u).out
    moves = moving(losing, losing.u, out)
    assert np.mean((out["moved"] ** 2 / (out["variance"] * out["share"]))[moves]) == pytest.approx(1.0, abs=0.1)


def test_the_drive_of_an_imitation_does_not_tell_of_the_motion(shaken: Fit) -> None:
    """Were it to know more of the shaft than the counts tell, the torque constant would come out wrong."""
    errors = []
    for seed in range(4):
        fit = Fit(imitated(shaken, seed), shaken.terms, shaken.u)
        fit = fit.extended(term("torque_constant_error", {"r": 0.0}, (), 0.1)).maximise()
        errors.append(float(fit.u[-1]) / np.sqrt(covariance_of(fit)[-1, -1]))
    assert abs(np.mean(errors)) < 1.5


def test_the_model_that_made_an_imitation_fits_it(shaken: Fit) -> None:
    problem = imitated(shaken, 1)
    again = Fit(problem, (), shaken.u).maximise()
    assert again.log_likelihood == pytest.approx(shaken.log_likelihood, rel=0.15)
    assert again.u[[DISTURBANCE, CORRELATION]] == pytest.approx(shaken.u[[DISTURBANCE, CORRELATION]], abs=0.3)
