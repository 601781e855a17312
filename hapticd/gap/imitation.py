"""What a law gains on recordings that the model without it would make, along the path of the real ones.

The filter is not exact: near standstill, and within a cell of the encoder, it takes as normal what is not. A law that has
nothing to do with the device may gain by that, and imitations of the recording show how much.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap import constants
from hapticd.gap.fit import Fit
from hapticd.gap.kernel.device import moving_inertia
from hapticd.gap.kernel.imitate import imitate
from hapticd.gap.parallel import each

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.gap.problem import Problem

_NEAR = 0.1
"""Share of the travel that the shaft may be off the recorded path under the device's torque."""
_STIFFEST = 0.1
"""Square of the radians by which the drive that keeps it there may swing in a period."""


def is_artefact(better: Fit, other: Fit) -> bool:
    """Return whether what one model gains over another is no more than it may gain where the other one is the device.

    Cox's test of separate hypotheses (J. R. Stat. Soc. B 24, 1962), its mean and its variance simulated. What loses on
    imitations as much as it gains on the recordings, as a law does to an exact filter, is none.
    """
    per_block = other.problem.series.per_block

    def gains(seed: int) -> NDArray[np.float64]:
        problem = imitated(other, seed)
        ours, theirs = (Fit(problem, fit.terms, fit.u).out["log_p"].copy() for fit in (better, other))
        return per_block(ours - theirs)

    by_chance = np.array(each(gains, range(constants.IMITATIONS)))
    gain = float(np.sum(better.out["log_p"] - other.out["log_p"]))
    loss = -float(by_chance.sum(axis=1).mean())
    variance = float(by_chance.var(axis=0, ddof=1).sum()) * (1.0 + 1.0 / constants.IMITATIONS)
    return loss < gain and gain + loss < constants.INDISTINGUISHABLE * math.sqrt(variance)


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
    return replace(problem, series=replace(series, cell=cell, added=added), runs=[])
