"""Simulates an experiment: does it move the shaft safely, and how well would it distinguish competing laws?

The closed loop is simulated with one law as the true device, and the filters of both laws run on the simulated encoder. With
predictions μ_A and μ_B and information I (of the fitted disturbance), the log-likelihood ratio in favour of the true law
grows by

    ½ Σ I (μ_A − μ_B − S δ)² + ½ δᵀ H δ,

where S are the derivatives of B's predictions, and δ is the change of B's parameters that minimises the sum, within the
information H of the present data. Twice the sum is the square of the separation in standard errors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.config import ConfigError, apply_settings
from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import grip, late_record
from hapticd.gap._problem import Problem
from hapticd.gap.fit import Fit
from hapticd.gap.kernel.ticks import NOISE
from hapticd.gap.law_set import OUTLIER_COSTS
from hapticd.gap.model_file import with_effects
from hapticd.gap.recording import Recording
from hapticd.gap.series import series_of
from hapticd.gap.terms import BASE_WORDS, LINE, parameters_of_term
from hapticd.servo.excitation import ExcitationError, build
from hapticd.servo.simulate import simulate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hapticd.config import Config
    from hapticd.gap.arrays import Floats
    from hapticd.gap.terms import Term
    from hapticd.servo.experiment import Experiment

_MARGIN = 0.7
"""Share of a safety limit that a simulated experiment may use: the real device may move more than the model."""
_FEWEST_COUNTS = 20
"""Least motion of the shaft in raw counts."""


@dataclass(frozen=True)
class CompetingModel:
    """One set of laws, fitted to the present data.

    Attributes:
        terms: all its effects, with the fitted values as starts.
        noise: (5,) coordinates of the fitted noise.
        problem: nominal device and present data.
        config: the model with all effects.
        known: (k, k) information of the present data on its coordinates.
    """

    terms: tuple[Term, ...]
    noise: Floats
    problem: Problem
    config: Config
    known: Floats

    def on(self, problem: Problem) -> Fit:
        """Run its filter on the samples of a problem."""
        return Fit.started(problem, self.terms, self.noise)


def competing_model(model: Config, fit: Fit) -> CompetingModel | None:
    """A competing model from a fit.

    Args:
        model: the nominal model. fit: of a set of laws.

    Returns:
        None if its laws exclude each other.
    """
    whole = [term.moved(fit.u[fit.columns(k)]) for k, term in enumerate(fit.terms)]
    # In the next experiment nobody holds the handle; a late record and lines are not part of the device.
    terms = tuple(term for term in whole if term.slug not in (grip.SLUG, late_record.SLUG, LINE))
    entries = [(term.slug, parameters_of_term(term, term.start)) for term in terms if term.slug in CATALOGUE]
    own = dict(fit.problem.assumed_friction)
    own |= {term.slug: math.exp(term.start[0]) for term in terms if term.slug in BASE_WORDS.values()}
    try:
        config = with_effects(model, entries, own)
    except ConfigError:
        return None
    record = tuple(term for term in whole if term.slug == late_record.SLUG)
    known = Fit.started(fit.problem, (*terms, *record), fit.noise)
    slopes = _slopes(known)[:, : sum(len(term.coordinates) for term in terms)]
    information = slopes.T @ (slopes * known.out["information"][:, None])
    return CompetingModel(terms, fit.noise, fit.problem, config, information)


def _slopes(fit: Fit) -> Floats:
    """(n, k) derivatives of the predictions by the coordinates of all effects."""
    effects = np.arange(fit.u.size) >= len(NOISE)
    fit.differentiate(effects)
    return fit.slopes[:, len(NOISE) :]


def separation(
    experiment: Experiment, pairs: Sequence[tuple[CompetingModel, CompetingModel]], least: float = 0.0
) -> float | None:
    """Worst-case separation of pairs by an experiment, in standard errors.

    Args:
        experiment: to simulate.
        pairs: (true model, claimed model).
        least: stop as soon as the separation is not above this.

    Returns:
        None if the experiment is outside the limits, a safety trip would end it, or the shaft would not move.
    """
    played: dict[int, Fit] = {}
    worst = np.inf
    for true, claimed in pairs:
        if id(true) not in played:
            recording = play(true.config, experiment)
            if recording is None:
                return None
            problem = true.problem
            problem = Problem(series_of([recording]), problem.base, problem.torque, problem.is_linear)
            played[id(true)] = true.on(problem)
        worst = min(worst, float(np.sqrt(2.0 * gain(played[id(true)], claimed))))
        if worst <= least:
            break
    return worst


def gain(true: Fit, claimed: CompetingModel) -> float:
    """Gain of a true model over a claimed one on data simulated with the true model, nats."""
    other = claimed.on(true.problem)
    difference, information = true.out["mean"] - other.out["mean"], true.out["information"]
    slopes = _slopes(other)
    H = slopes.T @ (slopes * information[:, None]) + claimed.known
    scale = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    g = slopes.T @ (information * difference)
    change = scale * (np.linalg.pinv(H * np.outer(scale, scale), rcond=1e-9, hermitian=True) @ (scale * g))
    left = difference - slopes @ change
    strained = 0.5 * float(change @ claimed.known @ change)
    return float(np.minimum(0.5 * information * left**2, OUTLIER_COSTS).sum()) + strained


def play(config: Config, experiment: Experiment) -> Recording | None:
    """The simulated recording of an experiment; None if it is outside the limits, trips, or hardly moves the shaft.

    Args:
        config: device, loop and limits; all trips are armed, at 70 % of the config's limits of speed and excursion.
        experiment: to simulate.
    """
    blocks: list[NDArray[Any]] = []
    try:
        config = apply_settings(config, experiment.settings, source="next experiment")
        table = build(config, experiment.excitation, **experiment.plan())
    except (ConfigError, ExcitationError):
        return None
    config = _with_margin(config)
    # The position within a raw count is unknown; start in its middle.
    report = simulate(
        config,
        table.shape[1] / config.servo.rate_hz,
        deflection=0.5 / config.encoder.decimation,
        safety=True,
        excitation=table,
        on_rows=lambda rows: blocks.append(rows.copy()),
    )
    rows = np.concatenate(blocks)
    if report["fault"] or np.ptp(rows["encoder_counts"]) < _FEWEST_COUNTS:
        return None
    resolution = config.raw_resolution
    return Recording(
        name=experiment.excitation,
        time_s=rows["time_s"] - rows["time_s"][0],
        position=(rows["encoder_counts"] + 0.5) * resolution,
        resolution=resolution,
        current=rows["current_command_A"].astype(np.float64),
        current_measured=None,
        period_s=config.period,
        is_linear=config.is_linear,
    )


def _with_margin(config: Config) -> Config:
    safety = config.safety
    limits = {
        name: _MARGIN * limit
        for name, limit in (("max_velocity", safety.max_velocity), ("max_excursion", safety.max_excursion))
        if limit
    }
    return config.model_copy(update={"safety": safety.model_copy(update=limits)})
