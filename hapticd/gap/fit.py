"""Maximum likelihood fit of a hypothesis, and its held-out score.

Coordinates: the logarithms of the noise parameters (torques over the ratio of torque constant to nominal one), then
those of each term. A step is Fisher's scoring, with the expected information of means and variances; derivatives are finite
differences of the filter.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.gap import constants
from hapticd.gap.kernel.filter import run_filter
from hapticd.gap.kernel.linear import sensitivities
from hapticd.gap.kernel.samples import Samples
from hapticd.gap.kernel.ticks import CORRELATION, DISTURBANCE, JITTER, NOISE, TICK, WHITE
from hapticd.gap.parallel import check_cancelled, parallel_map
from hapticd.gap.terms import LINE, RECORD_FILTER, line_torques, torque_slopes
from hapticd.plant.effect_terms import torque_constant

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hapticd.gap._problem import Problem
    from hapticd.gap.arrays import Floats
    from hapticd.gap.terms import Term

_NOISES = len(NOISE)
_OFF = (DISTURBANCE, JITTER)
"""Noise that is off at its lower bound."""
_NEVER = -1e12
_LEAST_DAMPING = 1e-6
"""Least damping of a step, as a share of the information's diagonal: keeps a system regular that is not identifiable."""
_POOR = 2
"""An ascent ends after this many steps in a row without gain: on a curved ridge a single step may fail."""
_HOPELESS = 0.05
"""Share of its distance to a competitor's likelihood that an ascent must gain in a step."""
_SHORTER = 6
"""Attempts with a shorter step if the likelihood does not rise."""
_FLAT = 0.01
"""A step is not tried if its predicted gain (half of Newton's decrement) is below this share of the tolerance."""
_STRAIGHT = 0.75
"""A step is doubled if it gains more than this share of its linear prediction: at a parabola's maximum it is a half."""
_SCANNED = 0.05
"""Least gain of a doubled step [nats]."""


class Fit:
    """A hypothesis and its coordinates.

    Attributes:
        problem: what is fitted.
        terms: effects, in the order in which they were added.
        u: (k,) coordinates, the noise first.
        log_likelihood: with the priors on base parameters and a late record, in nats.
        scores: (n, k) derivative of each sample's log probability, after `differentiate` and until `held_out`.
        slopes: (n, k) derivative of each sample's predicted measurement.
        spreads: (n, k) derivative of the logarithm of its variance, as long as `scores`.
    """

    def __init__(self, problem: Problem, terms: Sequence[Term], u: Floats) -> None:
        self.problem = problem
        self.terms = tuple(terms)
        coordinates = [coordinate for item in terms for coordinate in item.coordinates]
        low, high = problem.noise_bounds
        self.lower = np.concatenate([low, [c.lower for c in coordinates]])
        self.upper = np.concatenate([high, [c.upper for c in coordinates]])
        self.scale = np.concatenate([np.ones(_NOISES), [c.scale for c in coordinates]])
        self.prior = np.concatenate([np.full(_NOISES, np.inf), [c.prior for c in coordinates]])
        self.centre = np.concatenate([np.zeros(_NOISES), [c.centre for c in coordinates]])
        self.u = np.clip(u, self.lower, self.upper)
        self.error = 1e-2 * self.scale
        self.scores = np.zeros((0, 0))
        self.slopes = np.zeros((0, 0))
        self.spreads = np.zeros((0, 0))
        self._out: NDArray[Any] | None
        self.log_likelihood, self._out = self.evaluate(self.u)

    @property
    def out(self) -> NDArray[Any]:
        """(n,) of `TICK` at `u`."""
        if self._out is None:
            _, self._out = self.evaluate(self.u)
        return self._out

    @property
    def noise(self) -> Floats:
        """Coordinates of the noise."""
        return self.u[:_NOISES]

    def noise_values(self, u: Floats | None = None) -> Floats:
        """Noise parameters in SI units; those that are off are 0.

        The coordinates of noise torques are currents times the nominal torque constant. So a common factor of all torques
        and a factor of the torque constant have the same likelihood.
        """
        u = self.u if u is None else u
        values = np.exp(u[:_NOISES])
        values[[WHITE, DISTURBANCE]] *= torque_constant(self.device(u)) / torque_constant(self.problem.base)
        for k in _OFF:
            if u[k] <= self.lower[k] + 1e-9:
                values[k] = 0.0
        return values

    @property
    def own_slopes(self) -> Floats:
        """(n, j) derivatives of the predictions by those coordinates of the terms that were differentiated."""
        if not self.slopes.size:  # dropped
            self.differentiate()
        own = self.slopes[:, _NOISES:]
        return own[:, np.any(own != 0.0, axis=0)]

    def columns(self, number: int) -> slice:
        """Slice of a term's coordinates in `u`, and of its columns in the derivatives."""
        first = _NOISES + sum(len(item.coordinates) for item in self.terms[:number])
        return slice(first, first + len(self.terms[number].coordinates))

    def device(self, u: Floats | None = None) -> Floats:
        """The device vector."""
        u, p = self.u if u is None else u, self.problem.base.copy()
        for number, item in enumerate(self.terms):
            item.put(p, u[self.columns(number)])
        return p

    def evaluate(self, u: Floats, *, is_column: bool = False) -> tuple[float, NDArray[Any]]:
        """Log-likelihood and ticks at coordinates; `is_column`: one of several parallel runs for derivatives."""
        check_cancelled()
        series = self.problem.series
        p = self.device(u)
        out = np.empty(series.size, TICK)
        samples = Samples(series.resolution, series.time_s, series.cell, series.begins, *self.currents(u))
        total = run_filter(p, self.noise_values(u), samples, out)
        (self.problem.columns if is_column else self.problem.runs).append(series.size)
        prior = -0.5 * float(np.sum(((u - self.centre) / self.prior) ** 2))
        return (total + prior if np.isfinite(total) else _NEVER), out

    def filter_s(self, u: Floats | None = None) -> float:
        """Time constant of a filter between the current and its record [s]; 0 for none."""
        u = self.u if u is None else u
        for number, item in enumerate(self.terms):
            if item.coordinates and item.coordinates[0].name == RECORD_FILTER:
                return float(np.exp(u[self.columns(number).start]))
        return 0.0

    def currents(self, u: Floats | None = None) -> tuple[Floats, Floats, Floats]:
        """Duration [s], motor current and its standard deviation [A] of each part of each period, shape (n, parts) each."""
        u, series = self.u if u is None else u, self.problem.series
        p = self.device(u)
        duration, current, spread = series.currents(p, self.filter_s(u))
        for number, item in enumerate(self.terms):
            if item.slug == LINE:
                torque = line_torques(item, series) @ u[self.columns(number)]
                current = current + (torque / torque_constant(p))[:, None]
        return duration, current, spread

    def free(self, gradient: Floats | None = None) -> NDArray[np.bool_]:
        """(k,) which coordinates may change; with a gradient, not those that it pushes against a bound."""
        free = np.ones(self.u.size, dtype=bool)
        off = self.u[DISTURBANCE] <= self.lower[DISTURBANCE] + 1e-9
        free[DISTURBANCE] = free[CORRELATION] = not off
        free[JITTER] = self.u[JITTER] > self.lower[JITTER] + 1e-9
        if gradient is not None:
            free &= ~((self.u <= self.lower) & (gradient < 0.0)) & ~((self.u >= self.upper) & (gradient > 0.0))
        return free

    def differentiate(self, only: NDArray[np.bool_] | None = None) -> None:
        """Compute scores and slopes at the present coordinates."""
        free = (self.free() if only is None else only).copy()
        self.scores, self.slopes, self.spreads = (np.zeros((self.out.size, self.u.size), order="F") for _ in range(3))
        for number, item in enumerate(self.terms):
            own = self.columns(number)
            columns = torque_slopes(item, self.u[own], self.out["x"], self.problem.series)
            if columns is not None and free[own].any():
                self.slopes[:, own] = sensitivities(self.out, columns)
                self.scores[:, own] = self.slopes[:, own] * self.out["score"][:, None]
                free[own] = False
        steps = np.clip(0.1 * self.error, 1e-6 * self.scale, 0.03 * self.scale)
        steps = np.where(self.u + steps > self.upper, -steps, steps)

        def differentiate_by(j: int) -> None:
            u = self.u.copy()
            u[j] += steps[j]
            value, out = self.evaluate(u, is_column=True)
            if value > _NEVER:
                self._set_slopes(j, out, self.out, float(steps[j]))

        parallel_map(differentiate_by, np.flatnonzero(free).tolist())
        self.problem.runs.append(self.problem.series.size)

    def information(self, rows: slice = slice(None)) -> Floats:
        """Expected information of means and variances on the differentiated coordinates, shape (k, k)."""
        slopes, spreads, out = self.slopes[rows], self.spreads[rows], self.out[rows]
        of_means: Floats = slopes.T @ (slopes * out["information"][:, None])
        of_variances: Floats = 0.5 * spreads.T @ (spreads * out["share"][:, None] ** 2)
        return of_means + of_variances

    def approach(self, first: int, rounds: int) -> Fit:
        """Ascend in the coordinates from `first` on, with all noise scaled together; returns itself.

        It starts with the noise of the smaller model, where the likelihood is broad; the noise shrinks as the fit improves
        (homotopy).
        """
        self._follow([np.arange(self.u.size) >= first], rounds)
        return self

    def in_turn(self, rounds: int) -> None:
        """Ascend in each term separately: in a common step, a term with a non-smooth likelihood would stop the others."""
        at = np.arange(self.u.size)
        own = [self.columns(number) for number in range(len(self.terms))]
        self._follow([(columns.start <= at) & (at < columns.stop) for columns in own], rounds)

    def _follow(self, groups: Sequence[NDArray[np.bool_]], rounds: int) -> None:
        for _ in range(rounds):
            before = self.log_likelihood
            for free in groups:
                self._step(free, 1e-2)
                self.scan_power()
            if self.log_likelihood - before < 1.0:
                break
        self._forget()

    def maximise(self, iterations: int = 25, tolerance: float = 0.05, competitor: float = -np.inf) -> Fit:
        """Ascend to the maximum, with a coarser tolerance the farther it is below a competitor; returns itself."""
        damping, poor = 1e-2, 0
        held = np.zeros(self.u.size, dtype=bool)  # at a bound; released when the ascent gains no more
        for _ in range(iterations):
            before, among = self.log_likelihood, self.free() & ~held
            damping, free = self._step(among, damping, _FLAT * tolerance)
            enough = max(tolerance, _HOPELESS * (competitor - self.log_likelihood))
            poor = poor + 1 if self.log_likelihood - before < enough else 0
            held = (held | (among & ~free)) & (poor == 0)
            if poor == _POOR:
                break
        return self

    def _step(self, among: NDArray[np.bool_], damping: float, least: float = 0.0) -> tuple[float, NDArray[np.bool_]]:
        """One damped step of Fisher's scoring, if its predicted gain is more than `least`.

        Returns the damping for the next step, and which coordinates were free.
        """
        self.differentiate(among & self.free())
        precision = self.prior**-2.0
        gradient = self.scores.sum(axis=0) - precision * (self.u - self.centre)
        free = among & self.free(gradient)
        if not free.any():
            return damping, free
        H = self.information() + np.diag(precision)
        diagonal = np.diag(H) + 1e-12 / self.scale**2
        self.error = np.where(free, 1.0 / np.sqrt(diagonal), self.error)
        index = np.ix_(free, free)
        whole = H[index] + _LEAST_DAMPING * np.diag(diagonal[free])
        predicted = 0.5 * float(gradient[free] @ np.linalg.solve(whole, gradient[free]))
        if predicted < least:
            return damping, free
        for _ in range(_SHORTER):
            step = np.zeros(self.u.size)
            step[free] = np.linalg.solve(H[index] + damping * np.diag(diagonal[free]), gradient[free])
            step[:_NOISES] = np.clip(step[:_NOISES], -1.5, 1.5)
            before = self.log_likelihood
            if self.move(self.u + step):
                is_straight = self.log_likelihood - before > _STRAIGHT * float(gradient @ step)
                while is_straight and self.move(self.u + step, _SCANNED):
                    step *= 2.0
                return max(damping / 10.0, _LEAST_DAMPING), free
            damping = max(damping * 10.0, 1e-3)
        return damping, free

    def move(self, u: Floats, least: float = 0.0) -> bool:
        """Move to coordinates if that gains more than `least`; returns whether it moved."""
        u = np.clip(u, self.lower, self.upper)
        value, out = self.evaluate(u)
        if not value > self.log_likelihood + least:
            return False
        self.u, self.log_likelihood, self._out = u, value, out
        return True

    @classmethod
    def started(cls, problem: Problem, terms: Sequence[Term], noise: Floats) -> Fit:
        """A hypothesis at the starts of its terms."""
        return cls(problem, terms, np.concatenate([noise, *[np.asarray(item.start) for item in terms]]))

    def extended(self, item: Term) -> Fit:
        """This hypothesis at the same coordinates with one more term, at its start."""
        return Fit(self.problem, (*self.terms, item), np.concatenate([self.u, item.start]))

    def without(self, number: int, noise: Floats | None = None) -> Fit:
        """This hypothesis at the same coordinates without a term; with another noise if one is given."""
        u = np.delete(self.u, np.arange(self.u.size)[self.columns(number)])
        if noise is not None:
            u[:_NOISES] = noise
        return Fit(self.problem, (*self.terms[:number], *self.terms[number + 1 :]), u)

    def replaced(self, number: int, item: Term) -> Fit:
        """This hypothesis with one term replaced and at its start, the rest at the same coordinates."""
        own = self.columns(number)
        terms = (*self.terms[:number], item, *self.terms[number + 1 :])
        return Fit(self.problem, terms, np.concatenate([self.u[: own.start], item.start, self.u[own.stop :]]))

    def renamed(self, slug: str, other: str) -> Fit:
        """This hypothesis with another slug for a term."""
        fit = copy(self)
        fit.terms = tuple(replace(item, slug=other) if item.slug == slug else item for item in self.terms)
        return fit

    def at(self, u: Floats) -> Fit:
        """The same hypothesis at other coordinates."""
        return Fit(self.problem, self.terms, u)

    def with_noise(self, noise: Floats) -> Fit:
        """The same hypothesis at the same coordinates with another noise."""
        return self.at(np.concatenate([noise, self.u[_NOISES:]]))

    def with_slow_disturbance(self, tolerance: float) -> Fit:
        """The same hypothesis, fitted with the larger bound of the disturbance's correlation time."""
        free = self.on(self.problem.with_slow_disturbance())
        held_back = self.u[CORRELATION] >= self.upper[CORRELATION] - 1e-9 and self.noise_values()[DISTURBANCE] > 0.0
        if not held_back:
            return free
        slow = self.problem.slow_noise
        if slow:
            free = max(free, free.with_noise(slow[-1]), key=lambda one: one.log_likelihood)
        free.maximise(tolerance=tolerance)
        slow.append(free.noise.copy())
        return free

    def on(self, problem: Problem) -> Fit:
        """The same hypothesis at the same coordinates on other samples."""
        return Fit(problem, self.terms, self.u)

    def with_torque(self, torque: Floats) -> Fit:
        """The same hypothesis with a known additional torque, shape (n,), N m or N."""
        series = self.problem.series
        added = series.added + torque / torque_constant(self.device())
        return self.on(replace(self.problem, series=replace(series, added=added)))

    def scan_power(self) -> None:
        """Line search that scales all process noise down together: there the likelihood is least like a parabola."""
        step = np.where(np.isin(np.arange(self.u.size), (WHITE, DISTURBANCE)), -0.7, 0.0)
        while self.move(self.u + step, _SCANNED):
            step *= 1.5

    def held_out(self) -> Floats:
        """Log-likelihood of each block with parameters estimated without its fold, shape (blocks,).

        That estimate is one scoring step from the full one, in the effects only: all folds share the noise parameters.
        The step is shortened until it does not lower the likelihood of the folds that it was computed from.
        """
        self.differentiate()
        series = self.problem.series
        effects = np.zeros(self.u.size, dtype=bool)
        effects[_NOISES:] = True
        effects &= self.free(self.scores.sum(axis=0))
        whole = np.sum(self.scores[:, effects] ** 2, axis=0) + 1e-12 / self.scale[effects] ** 2

        def without(fold: int) -> tuple[Floats, Floats]:
            outside = series.fold[series.block] != fold
            kept, log_p = self.scores[outside][:, effects], self.out["log_p"]
            if effects.any():
                H = kept.T @ kept + constants.HELD_BACK * np.diag(whole)
                step = np.linalg.solve(H, kept.sum(axis=0))
                for share in (1.0, 0.3, 0.1):
                    trial = self.u.copy()
                    trial[effects] += share * step
                    trial = np.clip(trial, self.lower, self.upper)
                    ticks = self.evaluate(trial)[1]["log_p"]
                    if float(ticks[outside].sum()) >= float(log_p[outside].sum()) - 1e-3:
                        return trial, series.per_block(ticks)
            return self.u, series.per_block(log_p)

        found = parallel_map(without, range(constants.FOLDS))
        self.fold_u = [u for u, _ in found]
        total = np.choose(series.fold, [held_out for _, held_out in found])
        slopes = self.slopes
        self._forget()
        self.slopes = slopes
        return total

    def _forget(self) -> None:
        """Drop all derivatives."""
        self.scores = self.slopes = self.spreads = np.zeros((0, 0))

    def _set_slopes(self, j: int, above: NDArray[Any], below: NDArray[Any], step: float) -> None:
        """Set the derivatives by one coordinate, from the ticks of two runs that are `step` apart in it."""
        self.scores[:, j] = (above["log_p"] - below["log_p"]) / step
        self.slopes[:, j] = (above["mean"] - below["mean"]) / step
        self.spreads[:, j] = np.log(above["variance"] / below["variance"]) / step
