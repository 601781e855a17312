"""Recordings that a model would make, along the path of the real ones.

The filter is not exact: near standstill, and within a cell of the encoder, it takes as normal what is not. Imitations of the
recording show how far an estimate goes by that.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.kernel.device import moving_inertia
from hapticd.gap.kernel.imitate import imitate

if TYPE_CHECKING:
    from hapticd.gap.fit import Fit
    from hapticd.gap.problem import Problem

_NEAR = 0.1
"""Share of the travel that the shaft may be off the recorded path under the device's torque."""
_STIFFEST = 0.1
"""Square of the radians by which the drive that keeps it there may swing in a period."""


def imitated(fit: Fit, seed: int) -> Problem:
    """The problem with a recording that the model makes in place of the real one, under nearly the same current."""
    problem = fit.problem
    series, p = problem.series, fit.device()
    duration, current, spread = fit.currents()
    x, v = fit.out["x"], fit.out["v"]
    travel = max(float(np.ptp(x[series.recording == number])) for number in np.unique(series.recording))
    inertia = moving_inertia(p, 0.0)
    stiffness = problem.torque / (_NEAR * max(travel, series.resolution))
    stiffness = min(stiffness, _STIFFEST * inertia / series.period_s**2)
    added, cell = np.empty(series.size), np.empty(series.size)
    imitate(
        p,
        fit.noise_values(),
        series.resolution,
        float(series.cell[0] % 1.0),
        series.time_s,
        duration,
        current,
        spread,
        series.begins,
        1.5 * max(series.periods_s),
        np.column_stack([x, v]),
        stiffness,
        2.0 * np.sqrt(stiffness * inertia),
        np.random.default_rng(seed).normal(size=(series.size, 4)),
        added,
        cell,
    )
    return replace(problem, series=replace(series, cell=cell, added=series.added + added), runs=[])
