"""The first fit: starts of the noise and of the base parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.fit import Fit
from hapticd.gap.kernel.ticks import CORRELATION, DISTURBANCE, JITTER, NOISE, WHITE
from hapticd.gap.parallel import parallel_map

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.gap._problem import Problem
    from hapticd.gap.arrays import Floats
    from hapticd.gap.terms import Term


_STEPS = 40


def first_noise(problem: Problem, terms: Sequence[Term]) -> Floats:
    """Start of a fit: its noise is the best of a coarse grid, white only or with a disturbance."""
    low, high = problem.noise_bounds
    T, q = problem.series.period_s, problem.series.resolution
    noise = np.array(
        [0.0, np.log(0.3 * q), low[DISTURBANCE], 0.5 * (low[CORRELATION] + high[CORRELATION]), low[JITTER]]
    )
    probe = Fit.started(problem, terms, noise)

    def best_of(tried: list[Floats]) -> tuple[float, Floats]:
        values = parallel_map(lambda u: probe.evaluate(u)[0], tried)
        k = int(np.argmax(values))
        return values[k], tried[k]

    def changed(u: Floats, **words: float) -> Floats:
        u = u.copy()
        for name, value in words.items():
            u[NOISE.index(name)] = value
        return np.clip(u, probe.lower, probe.upper)

    coarse = [
        changed(probe.u, white=white, sensor=np.log(sensor * q))
        for white in np.log(problem.torque * np.sqrt(T)) + np.arange(-9.0, 5.0, 1.5)
        for sensor in (0.1, 0.5, 5.0, 50.0, 500.0)
    ]
    best, best_u = best_of(coarse)
    spread = best_u[WHITE]
    others = [
        changed(best_u, white=spread + less, disturbance=power + spread - 0.5 * (np.log(2.0) + tau), memory=tau)
        for less in (0.0, -1.2, -3.5)
        for tau in np.linspace(low[CORRELATION], high[CORRELATION], 3)
        for power in (0.4, -0.7, -1.9, -3.0, -4.2)
    ]
    best, best_u = max((best, best_u), best_of(others), key=lambda pair: pair[0])
    value, jittery = best_of([changed(best_u, jitter=np.log(jitter * T)) for jitter in (0.02, 0.1, 0.3)])
    return jittery if value > best + 1.0 else best_u


def nominal_fit(problem: Problem, terms: Sequence[Term] = ()) -> Fit:
    """The fit of the nominal model, with further terms."""
    return Fit(problem, terms, first_noise(problem.subsample(), terms)).maximise(_STEPS)


def likeliest_fit(problem: Problem, starts: Sequence[Sequence[Term]], noise: Floats) -> Fit:
    """The fit from the start that is likeliest after maximisation on a subsample; `noise` is that of the first start."""
    first, *others = starts
    if not others:
        return Fit.started(problem, first, noise).maximise(_STEPS)
    look = problem.subsample()
    parts = [Fit.started(look, first, noise), *(Fit(look, terms, first_noise(look, terms)) for terms in others)]
    best = max((part.maximise(_STEPS) for part in parts), key=lambda fit: fit.log_likelihood)
    return best.on(problem).maximise(_STEPS)
