"""The base fit: inertia, friction, bias and delay by the gap workflow's likelihood (docs/explanation/gap-statistics.md).

No effects are searched. Disturbance torque, sensor noise and sampling jitter are fitted too, so the intervals include the
uncertainty from unmodelled torques.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap import chance
from hapticd.gap.base_model import problem_of
from hapticd.gap.covariance import covariance_of
from hapticd.gap.fit import Fit
from hapticd.gap.kernel.ticks import DISTURBANCE
from hapticd.gap.nominal import first_noise
from hapticd.gap.terms import Coordinate, Term
from hapticd.plant.layout import index_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.config import Config
    from hapticd.gap.arrays import Floats
    from hapticd.gap.balance import Balance
    from hapticd.gap.recording import Recording

FITTED = ("inertia", "viscous", "coulomb", "bias", "delay_s")
"""The parameters, in the order of every vector and matrix here."""
_BIAS = FITTED.index("bias")
_OWN_ELEMENTS = ("delay_s", "transport_delay.t_d", "constant_bias.tau_0")
"""Elements of the device vector that are fitted instead of taken from the model."""
_FARTHEST = 100.0
"""Largest factor between a parameter and its start."""
_LONGEST_DELAY_S, _LONGEST_DELAY_PERIODS = 0.02, 10.0
_SCANNED_PERIODS = np.arange(0.1, 6.0, 0.2)
_SCANNED_ERRORS = (0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
"""Distances in standard errors at which another bias is tried."""
_SHAKE, _SHAKEN_STEPS = 1.2, 8
"""Logarithm of the factor by which the disturbance is increased; most steps with it."""
_POOR_STEP = 0.1
"""An ascent ends with a step of a smaller gain [nats]."""
_ROUGHLY = 0.5
"""The same while several starts are compared [nats]."""


@dataclass(frozen=True)
class BaseFit:
    """The estimate.

    Attributes:
        values: (5,) in the order of `FITTED`.
        covariance: (5, 5) of the values.
        fit: the maximum of the likelihood.
    """

    values: Floats
    covariance: Floats
    fit: Fit

    @property
    def coverage_factor(self) -> float:
        """Coverage factor: half width of a 95 % interval in standard deviations (Student's distribution over the blocks)."""
        return chance.standard_errors(0.025, self.fit.problem.series.blocks)

    def half_width(self, name: str) -> float:
        """Half width of the 95 % interval."""
        index = FITTED.index(name)
        return self.coverage_factor * float(np.sqrt(self.covariance[index, index]))

    @property
    def effective_s(self) -> float:
        """Effective duration of the data on the least certain parameter [s] (Kish's effective sample size)."""
        series = self.fit.problem.series
        information = self.fit.slopes[:, -len(FITTED) :] ** 2 * self.fit.out["information"][:, None]
        each = series.per_block(information)
        whole = each.sum(axis=0)
        blocks = whole**2 / np.maximum((each**2).sum(axis=0), 1e-300)
        return float(blocks[whole > 0.0].min(initial=np.inf)) * series.duration_s / series.blocks

    def scores(self) -> Floats:
        """(n, 5) derivative of each sample's log probability by the values."""
        return np.asarray(self.fit.scores[:, -len(FITTED) :] / _slopes(self.values))


def base_fit(recordings: Sequence[Recording], model: Config, start: Balance) -> BaseFit:
    """Fit the base model.

    Args:
        recordings: of one device, with the correct sign of the encoder.
        model: for what is not fitted: torque constant, effects, hand.
        start: start values.
    """
    problem = problem_of(recordings, model)
    base = problem.base.copy()
    base[[index_of(name) for name in _OWN_ELEMENTS]] = 0.0
    problem = replace(problem, base=base)
    terms = _terms(start, problem.torque, problem.series.period_s)
    look = problem.subsample()
    begun = Fit(look, terms, first_noise(look, terms))
    starts = (begun, _likeliest(begun, start.at_delays))
    found = max((_maximised(fit) for fit in starts), key=attrgetter("log_likelihood"))
    whole = found.on(problem.with_slow_disturbance())
    _scan_bias(whole)
    fit = _shaken(whole.maximise(tolerance=_ROUGHLY)).maximise()
    values = fit.u[-len(FITTED) :].copy()
    values[0] = np.exp(values[0])
    slopes = _slopes(values)
    covariance = covariance_of(fit)[-len(FITTED) :, -len(FITTED) :] * np.outer(slopes, slopes)
    wider = np.ones(len(FITTED))
    wider[_BIAS] = max(1.0, _least_error_of_bias(fit) / np.sqrt(covariance[_BIAS, _BIAS]))
    return BaseFit(values, covariance * np.outer(wider, wider), fit)


def _slopes(values: Floats) -> Floats:
    """Derivative of each value by its coordinate; only the inertia has a logarithmic coordinate."""
    slopes = np.ones(len(FITTED))
    slopes[0] = values[0]
    return slopes


def _likeliest(fit: Fit, at_delays: Floats) -> Fit:
    """A start from the likeliest of the balances at all delays, with the same noise.

    In slow motion a delay is hardly identifiable by least squares, and inertia and friction depend on it. With a strong
    disturbance, before the noise is fitted, the likeliest balance may be wrong: so it is only one of two starts.
    """
    noise = fit.noise
    fit = fit.on(fit.problem)
    for values in at_delays:
        fit.move(np.concatenate([noise, [np.log(values[0])], values[1:]]))
    return fit


def _maximised(fit: Fit) -> Fit:
    """An ascent that starts with a line search over all delays.

    This needs large noise: with small noise the likelihood has a local maximum near every delay.
    """
    for periods in _SCANNED_PERIODS:
        u = fit.u.copy()
        u[-1] = periods * fit.problem.series.period_s
        fit.move(u)
    return fit.maximise(40, _ROUGHLY)


def _least_error_of_bias(fit: Fit) -> float:
    """Cramér–Rao bound on the standard error of the bias, as if the torque were measured directly, N m or N.

    The bias is not identifiable from the mean of the disturbance, a Gauss–Markov process of variance s² and correlation
    time τ. Over a time T, an unbiased estimate of that mean has at least the variance 2 s² τ / (T + 2τ).
    """
    _, _, rms, memory_s, _ = fit.noise_values()
    return float(rms * np.sqrt(2.0 * memory_s / (fit.problem.series.duration_s + 2.0 * memory_s)))


def _scan_bias(fit: Fit) -> None:
    """Line search over biases as large as the mean of the disturbance may be: the likelihood has several maxima there."""
    centre, error = fit.u[_BIAS - len(FITTED)], _least_error_of_bias(fit)
    for errors in _SCANNED_ERRORS:
        for side in (1.0, -1.0):
            u = fit.u.copy()
            u[_BIAS - len(FITTED)] = centre + side * errors * error
            fit.move(u)


def _shaken(fit: Fit) -> Fit:
    """A better maximum than the present one, found with a temporarily larger disturbance; else the present one.

    The disturbance determines when the shaft sticks, so the likelihood has several maxima, which merge if it is larger.
    """
    if fit.noise[DISTURBANCE] <= fit.lower[DISTURBANCE] + 1e-9:
        return fit
    noise = fit.noise.copy()
    noise[DISTURBANCE] += _SHAKE
    other = fit.with_noise(noise)
    _scan_bias(other)
    _ascend(other)
    other = other.with_noise(fit.noise)
    _scan_bias(other)
    other.maximise(tolerance=_ROUGHLY)
    return other if other.log_likelihood > fit.log_likelihood else fit


def _ascend(fit: Fit) -> None:
    """Gauss–Newton steps in the fitted parameters, with fixed noise."""
    own = np.arange(fit.u.size) >= fit.noise.size
    for _ in range(_SHAKEN_STEPS):
        before = fit.log_likelihood
        fit.differentiate(own)
        S = fit.scores[:, own]
        H = S.T @ S
        step = np.zeros(fit.u.size)
        step[own] = np.linalg.solve(H + 1e-3 * np.diag(np.diag(H) + 1e-300), S.sum(axis=0))
        if not any(fit.move(fit.u + fraction * step) for fraction in (1.0, 0.3, 0.1)):
            break
        if fit.log_likelihood - before < _POOR_STEP:
            break


def _terms(start: Balance, torque: float, period_s: float) -> tuple[Term, ...]:
    """One term per parameter: the inertia by its logarithm, the others, in which the torque is linear, by their value."""
    far = float(np.log(_FARTHEST))
    J = float(np.log(start.inertia))
    longest = max(_LONGEST_DELAY_S, _LONGEST_DELAY_PERIODS * period_s)
    return (
        _term("inertia", "inertia", J, J - far, J + far, 0.3, is_log=True),
        _term("viscous", "viscous", start.viscous, 0.0, _FARTHEST * start.viscous, 0.3 * start.viscous),
        _term("coulomb", "coulomb", start.coulomb, 0.0, _FARTHEST * start.coulomb, 0.3 * start.coulomb),
        _term("bias", "constant_bias.tau_0", start.bias, -_FARTHEST * torque, _FARTHEST * torque, 0.1 * torque),
        _term("delay_s", "delay_s", start.delay_s, 0.0, longest, 0.2 * period_s),
    )


def _term(
    name: str, place: str, start: float, lower: float, upper: float, scale: float, *, is_log: bool = False
) -> Term:
    return Term(name, (Coordinate(name, index_of(place), is_log, lower, upper, scale),), (start,))
