"""Simulated recordings along the path of the real ones (parametric bootstrap).

The filter is approximate: near standstill, and within an encoder cell, it assumes normal distributions. Estimates from
simulated recordings show the error of that.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.kernel.device import moving_inertia
from hapticd.gap.kernel.imitate import Drive, imitate
from hapticd.gap.kernel.samples import Samples

if TYPE_CHECKING:
    from hapticd.gap._problem import Problem
    from hapticd.gap.fit import Fit

_NEAR = 0.1
"""Largest deviation from the recorded path under the device's torque, as a share of the travel."""
_STIFFEST = 0.1
"""Square of the natural frequency, in radians per period, of the controller that keeps the shaft on the path; at most."""


def imitated(fit: Fit, seed: int) -> Problem:
    """The problem with a simulated recording instead of the real one, under nearly the same current."""
    problem = fit.problem
    series, p = problem.series, fit.device()
    duration, current, spread = fit.currents()
    x, v = fit.out["x"], fit.out["v"]
    travel = max(float(np.ptp(x[series.recording == number])) for number in np.unique(series.recording))
    inertia = moving_inertia(p, 0.0)
    stiffness = problem.torque / (_NEAR * max(travel, series.resolution))
    stiffness = min(stiffness, _STIFFEST * inertia / series.period_s**2)
    added, cell = np.empty(series.size), series.cell.copy()
    samples = Samples(series.resolution, series.time_s, cell, series.begins, duration, current, spread)
    damping = 2.0 * np.sqrt(stiffness * inertia)
    drive = Drive(np.column_stack([x, v]), float(stiffness), float(damping), 1.5 * max(series.periods_s))
    normal = np.random.default_rng(seed).normal(size=(series.size, 4))
    imitate(p, fit.noise_values(), samples, drive, normal, added)
    return replace(problem, series=replace(series, cell=cell, added=series.added + added), runs=[])
