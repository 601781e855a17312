"""The fit of the model as given: from where its noise starts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.fit import Fit
from hapticd.gap.kernel.ticks import CORRELATION, DISTURBANCE, JITTER, NOISE, WHITE
from hapticd.gap.parallel import each

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.gap.arrays import Floats
    from hapticd.gap.problem import Problem
    from hapticd.gap.terms import Term


def first_noise(problem: Problem, terms: Sequence[Term]) -> Floats:
    """Coordinates from which a fit starts: the noise is the best of a coarse grid, white alone and with a disturbance."""
    low, high = problem.noise_bounds
    T, q = problem.series.period_s, problem.series.resolution
    noise = np.array(
        [0.0, np.log(0.3 * q), low[DISTURBANCE], 0.5 * (low[CORRELATION] + high[CORRELATION]), low[JITTER]]
    )
    probe = Fit.started(problem, terms, noise)

    def best_of(tried: list[Floats]) -> tuple[float, Floats]:
        values = each(lambda u: probe.evaluate(u)[0], tried)
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
    beside = [
        changed(best_u, white=spread + less, disturbance=power + spread - 0.5 * (np.log(2.0) + tau), memory=tau)
        for less in (0.0, -1.2, -3.5)
        for tau in np.linspace(low[CORRELATION], high[CORRELATION], 3)
        for power in (0.4, -0.7, -1.9, -3.0, -4.2)
    ]
    best, best_u = max((best, best_u), best_of(beside), key=lambda pair: pair[0])
    value, jittery = best_of([changed(best_u, jitter=np.log(jitter * T)) for jitter in (0.02, 0.1, 0.3)])
    return jittery if value > best + 1.0 else best_u


def nominal_fit(problem: Problem, terms: Sequence[Term] = ()) -> Fit:
    """The fit of the nominal model, with terms that correct its base parameters where asked for.

    Those climb from two sides, as given and from a shaft that is as heavy and as free as it may be: too light a shaft
    that friction holds has maxima of its own, where a disturbance moves it; a heavy one coasts past them.
    """
    look = problem.first_look()
    starts = [terms]
    if {"inertia", "coulomb"} & {item.slug for item in terms}:
        starts.append([_heavy_and_free(item) for item in terms])
    fits = [Fit(problem, start, first_noise(look, start)).maximise(40) for start in starts]
    return max(fits, key=lambda fit: fit.log_likelihood)


def _heavy_and_free(item: Term) -> Term:
    if item.slug == "inertia":
        return item.moved([item.coordinates[0].upper])
    return item.moved([item.coordinates[0].lower]) if item.slug == "coulomb" else item
