"""Find where a model and recordings part, name what is missing, add it, and go round until nothing is left to name."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers import declared_latency
from hapticd.config import unit_of
from hapticd.effects.catalogue import CATALOGUE, EFFECT_SLUGS
from hapticd.gap import chance, constants, grip, late_record, missing
from hapticd.gap.competition import CrossValidated, Round, cross_validate, evidence
from hapticd.gap.corrections import CORRECTIONS
from hapticd.gap.covariance import covariance_of
from hapticd.gap.fit import Fit
from hapticd.gap.kernel.ticks import NOISE
from hapticd.gap.missing import Missing, missing_force
from hapticd.gap.model_file import BASE_KEYS
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.parallel import one_blas_thread
from hapticd.gap.prediction import prediction_errors
from hapticd.gap.problem import LEAST_START, Problem
from hapticd.gap.profile import Profile
from hapticd.gap.remainder import remainder_of
from hapticd.gap.result import Estimate, GapNumbers, GapResult, Ranked, Step
from hapticd.gap.search import critical, is_quiet, search, withstanding
from hapticd.gap.series import series_of
from hapticd.gap.terms import Coordinate, Term, parameters_of_term
from hapticd.gap.verdict import decide, doubts_about
from hapticd.plant.effect_terms import torque_constant
from hapticd.plant.layout import NAMES, device_vector, index_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from hapticd.config import Config
    from hapticd.gap.recording import Recording

_FARTHEST = {"inertia": 10.0, "viscous": 100.0, "coulomb": 100.0}
"""Factor by which a base parameter may leave its nominal value. A shaft heavier than that ignores the current."""
_MOST_WORK = 1.5
"""Work against Coulomb friction over the current's: beyond, friction holds the shaft, and a disturbance moves it."""
_NOTHING = 1e-6
"""What a friction that the model has not is instead, over the device's torques: nothing that shows."""


@one_blas_thread
def find_gap(
    recordings: Sequence[Recording],
    model: Config,
    *,
    refit_base: bool = False,
    candidates: Sequence[str] | None = None,
    progress: Callable[[float, str], None] | None = None,
    design: bool = True,
) -> GapResult:
    """Find the effects that a model lacks.

    Args:
        recordings: one or several runs of the same device.
        model: the nominal model.
        refit_base: fit inertia and friction of the base model too, before and with every effect.
        candidates: slugs to consider; the whole catalogue by default.
        progress: told the fraction done and what is being done.
        design: where laws stay indistinguishable, design the experiment that would tell them apart.

    Raises:
        ValueError: no recording, a candidate that is unknown, or none that can be looked for.
        KeyboardInterrupt: interrupted before an effect was named; afterwards the result has what was found until then.
    """
    slugs, not_considered = considered(model, candidates, refit_base=refit_base)
    progress = progress or (lambda fraction, text: None)
    progress(0.0, "fitting the model as given")
    problem = problem_of(recordings, model, LEAST_START if refit_base else _NOTHING)
    base = base_terms(problem) if refit_base else ()
    first = cross_validate(nominal_fit(problem, base))
    rounds: list[Round] = []
    interrupted, unnamed = False, None
    try:
        unnamed = search(first, slugs, progress, rounds)
        if rounds and late_record.is_late(law := rounds[-1].taken.law):
            beside = (*base, late_record.along(law))
            first, base = cross_validate(nominal_fit(problem, beside)), beside
            slugs = [slug for slug in slugs if slug != late_record.DELAY]
            rounds.clear()
            unnamed = search(first, slugs, progress, rounds)
    except KeyboardInterrupt:
        if rounds and late_record.is_late(rounds[-1].taken.law):
            rounds.pop()  # no effect, and not yet fitted along
        if not rounds:
            raise
        interrupted = True
    progress(0.9, "what is left")
    answer, named = partial(_result, recordings, model, first, rounds, slugs, len(base), unnamed), tuple(rounds)
    try:
        result = answer()
    except KeyboardInterrupt:
        if not named:
            raise
        rounds[:], interrupted = named, True
        result = answer()  # some seconds that what was named cannot do without
    if design and result.verdict == "ambiguous" and not interrupted:
        from hapticd.gap.design import next_experiment

        try:
            planned = next_experiment(
                model, rounds, lambda fraction, text: progress(0.92 + 0.08 * fraction, text), len(base)
            )
            result = replace(result, next_experiment=planned)
        except KeyboardInterrupt:
            interrupted = True
    progress(1.0, "done")
    result.recording["warnings"].extend(not_considered)
    if interrupted:
        result = replace(result, interrupted=True, statement=f"Interrupted: {result.statement}")
    return result


def problem_of(recordings: Sequence[Recording], model: Config, least: float = _NOTHING) -> Problem:
    """What is fitted; a friction that the model has not is this share of the torque.

    Raises:
        ValueError: no recording.
    """
    series = series_of(recordings)
    vector = device_vector(model, declared_latency(model)[0])
    drive = model.amplifier.torque_constant * float(np.sqrt(np.mean(series.command**2)))
    way = series.resolution * float(np.ptp(series.cell))
    slowed = model.plant.inertia * way / series.duration_s**2  # all there is where a shaft without friction coasts
    torque = model.plant.coulomb + drive or slowed
    speed = series.resolution * float(np.abs(np.diff(series.cell)).sum()) / series.duration_s
    zero = [name for name in ("viscous", "coulomb") if vector[index_of(name)] == 0.0]
    begun = {name: least * torque / (speed if name == "viscous" else 1.0) for name in zero}
    for name, size in begun.items():
        vector[index_of(name)] = size
    return Problem(series, vector, torque, model.is_linear, begun)


def base_terms(problem: Problem) -> tuple[Term, ...]:
    """Terms that fit the base model: the logarithms of inertia, viscous and Coulomb friction, with a wide prior.

    Coulomb friction takes no more than `_MOST_WORK` times the current's work, or than the model says.
    """
    series, found = problem.series, []
    rows = max(round(constants.WINDOW_S / series.period_s), 1)
    runs = [series.cell[series.recording == number][::rows] for number in np.unique(series.recording)]
    way = sum(float(np.maximum(np.abs(np.diff(run)) - 1.0, 0.0).sum()) for run in runs)
    moved = np.where(np.diff(series.recording), 0.0, np.diff(series.cell))
    drive = torque_constant(problem.base) * float(series.command[:-1] @ moved) / max(way, 1.0)
    for name, farthest in _FARTHEST.items():
        index = index_of(name)
        given = float(problem.base[index])
        least, most = given / farthest, given * farthest
        if name == "coulomb":
            most = min(most, max(_MOST_WORK * drive, given))
        centre, low, high = (math.log(size) for size in (given, least, most))
        neutral = math.nan if name == "inertia" else low  # next to no friction is none
        coordinate = Coordinate(name, index, True, low, high, 0.3, constants.BASE_PRIOR, centre, neutral)
        found.append(Term(name, (coordinate,), (centre,)))
    return tuple(found)


def _why_not(slug: str, model: Config, refit_base: bool) -> str | None:
    """Why an effect cannot be looked for, or None."""
    present = {effect.name for effect in model.plant.effects}
    if refit_base and slug in CORRECTIONS:
        return "the base model is fitted along, which this is an error of"
    if model.is_linear and CATALOGUE[slug].rotary_only:
        return "its law is in an angle, and the device is linear"
    if slug in present:
        return "the model has it already"
    if among := present & set(CATALOGUE[slug].excludes):
        return f"the model has {among.pop()}, beside which it cannot be"
    return None


def considered(model: Config, candidates: Sequence[str] | None, *, refit_base: bool) -> tuple[list[str], list[str]]:
    """Effects that are looked for, and a sentence for each that was asked for and cannot be.

    Args:
        model: the nominal model. candidates: slugs that are asked for; None for the whole catalogue.
        refit_base: whether inertia and friction of the base model are fitted along.

    Raises:
        ValueError: one is unknown, or none can be looked for.
    """
    for slug in candidates or ():
        if slug not in CATALOGUE:
            raise ValueError(f"unknown effect {slug!r}: the catalogue has {', '.join(EFFECT_SLUGS)}")
    chosen = EFFECT_SLUGS if candidates is None else [slug for slug in EFFECT_SLUGS if slug in candidates]
    reasons = {slug: reason for slug in chosen if (reason := _why_not(slug, model, refit_base))}
    left = [slug for slug in chosen if slug not in reasons]
    sentences = [f"{slug} cannot be looked for: {reason}" for slug, reason in reasons.items()]
    if candidates and not left:
        raise ValueError("; ".join(sentences))
    return left, sentences if candidates else []


def _result(
    recordings: Sequence[Recording],
    model: Config,
    first: CrossValidated,
    rounds: list[Round],
    slugs: Sequence[str],
    fixed: int,
    unnamed: str | None,
) -> GapResult:
    quiet = not rounds and is_quiet(first.fit)
    # What was found is judged with a disturbance that may be slow: nothing is missing that it could be.
    freed = withstanding(first, rounds, len(slugs))
    first, last = freed[0], freed[-1]
    found = [missing_force(judged.fit) for judged in freed]
    power = [each.rms**2 for each in found]
    held = [missing.held_out_rms(first.fit), missing.held_out_rms(last.fit)]
    unit = "N" if model.is_linear else "N m"
    numbers = GapNumbers(found[0].rms, found[-1].rms, held[0], held[1], missing.noise_floor(last.fit), unit)
    possible = max(missing.explainable(first.fit, found[0]) * power[0], power[0] - power[-1], 1e-300)
    covariance = covariance_of(last.fit)
    steps = tuple(
        _step(each, number, last.fit, covariance, fixed, model.is_linear, power, possible)
        for number, each in enumerate(rounds)
    )
    effects = tuple(step.effect for step in steps)
    indistinguishable = [each.indistinguishable for each in rounds]
    remainder = remainder_of(last.fit, found[-1], power[0])
    beaten = {
        each.taken.slug: coordinate
        for each in rounds
        if not is_quiet(last.fit)
        and (coordinate := missing.better_function(each.before.fit, each.taken.law)) is not None
    }
    laws = [(last.fit.terms[number], last.fit.columns(number)) for number in range(fixed, fixed + len(rounds))]
    series = first.fit.problem.series
    half = _reach(series.blocks) * np.sqrt(np.diag(covariance))
    at_bounds = {law.slug: names for law, own in laws if (names := law.at_bounds(last.fit.u[own], half[own]))}
    late = late_record.described(last.fit, np.diag(covariance), _reach(series.blocks))
    timing = _timing(recordings)
    begun = first.fit.problem.begun
    warnings = [
        *timing["warnings"],
        *late["warnings"],
        *_relative_to(begun, effects, model.is_linear),
        *_not_told(last.fit, half),
    ]
    timing = {**timing, **late, "warnings": warnings}
    verdict, statement = decide(
        effects, indistinguishable, doubts_about(at_bounds, beaten, unnamed), numbers, remainder
    )
    noise = last.fit.noise_values()
    return GapResult(
        verdict,
        statement,
        effects,
        steps,
        numbers,
        remainder,
        where=tuple(missing.where(first.fit, found[0])),
        base=_base_estimates(last.fit, covariance, model.is_linear),
        begun=begun,
        prediction=prediction_errors(first.fit, last.fit, model.is_linear),
        recording=timing,
        details={
            "samples": series.size,
            "blocks": series.blocks,
            "candidates": list(slugs),
            "noise": dict(zip(NOISE, (float(value) for value in noise), strict=True)),
            "needed_standard_errors": critical(series.blocks, len(slugs)),
            "explainable_share": min(possible / power[0], 1.0) if power[0] > 0.0 else 0.0,
            "at_bounds": at_bounds,
            "predicted_better_by": beaten,
            "better_but_unnamed": unnamed,
            "is_quiet": quiet,
            "likelihood_evaluations": len(first.fit.problem.runs),
        },
        profiles=_profiles(recordings, first.fit, found[0], found[-1]),
    )


def _relative_to(begun: Mapping[str, float], effects: Sequence[str], is_linear: bool) -> list[str]:
    """What corrections of frictions that the model has not are relative to."""
    keys = {slug: ".".join(BASE_KEYS[slug]) for slug in effects if slug in BASE_KEYS}
    sizes = {f"plant.{name}": size for name, size in begun.items()}
    return [
        f"{key} of the model is 0: r of {slug} is relative to {sizes[key]:.3g} {unit_of(key, is_linear)}"
        for slug, key in keys.items()
        if key in sizes
    ]


def _not_told(fit: Fit, half: np.ndarray[Any, np.dtype[np.float64]]) -> list[str]:
    """Base parameters that are not told from the limit of what is fitted."""
    own = [(term, fit.columns(number)) for number, term in enumerate(fit.terms) if term.slug in _FARTHEST]
    untold = [term.slug for term, columns in own if term.at_bounds(fit.u[columns], half[columns])]
    if not untold:
        return []
    return [
        f"these data do not tell {' and '.join(untold)} from the most that is fitted: the model is of another device, or "
        "the motion is not the current's, as where a controller makes the current follow it. What is named depends on that."
    ]


def _step(
    each: Round,
    number: int,
    fit: Fit,
    covariance: np.ndarray[Any, np.dtype[np.float64]],
    fixed: int,
    is_linear: bool,
    power: Sequence[float],
    possible: float,
) -> Step:
    taken = each.taken
    term, own = fit.terms[fixed + number], fit.columns(fixed + number)
    u, variance = fit.u[own], np.diag(covariance)[own]
    blocks = fit.problem.series.blocks
    estimates = _estimates(term, u, variance, blocks, is_linear)
    if term.slug == grip.SLUG:
        ranges = grip.edge_ranges(fit, fixed + number)
        estimates |= {name: replace(estimates[name], ci95=ends) for name, ends in ranges.items()}
    same = CATALOGUE[taken.slug].equivalent_to
    ranking = tuple(
        Ranked(
            other.slug,
            other.gain,
            other.evidence,
            0.0 if other is taken else max(evidence(taken.judged, other.judged)[1], 0.0),
        )
        for other in each.contenders
    )
    return Step(
        taken.slug,
        estimates,
        float(np.sqrt(power[number])),
        float(np.sqrt(power[number + 1])),
        float(np.clip((power[number] - power[number + 1]) / possible, 0.0, 1.0)),
        taken.evidence,
        taken.gain,
        (*same, *(slug for slug in each.indistinguishable if slug not in same)),
        ranking,
        parameters_of_term(term, u),
    )


def _reach(blocks: int) -> float:
    """Standard errors to the ends of a 95 % interval."""
    return chance.standard_errors(0.025, blocks)


def _estimates(
    term: Term, u: np.ndarray[Any, np.dtype[np.float64]], variance: np.ndarray[Any, Any], blocks: int, is_linear: bool
) -> dict[str, Estimate]:
    units = {p.name: p.unit_linear if is_linear else p.unit for p in CATALOGUE[term.slug].parameters}
    reach = _reach(blocks)
    found = {}
    for index, chosen in term.fixed:
        name = NAMES[index].partition(".")[2]
        found[name] = Estimate(chosen, (chosen, chosen), units[name.partition("[")[0]])
    accuracy = CATALOGUE[term.slug].accuracy
    for coordinate, value, own in zip(term.coordinates, u, variance, strict=True):
        model = accuracy if coordinate.is_log else accuracy * abs(value)
        half = reach * math.hypot(float(np.sqrt(own)), model)
        found[coordinate.name] = _estimate(coordinate, value, half, units[coordinate.name.partition("[")[0]])
    return found


def _estimate(coordinate: Coordinate, value: float, half: float, unit: str) -> Estimate:
    """The estimate whose coordinate is `value`, give or take `half`, within its bounds."""
    # The logarithm of a magnitude that is next to nothing tells nothing of its upper end: its value does.
    further = math.log1p(half) if coordinate.is_log and value <= coordinate.lower else half
    ends = [min(max(end, coordinate.lower), coordinate.upper) for end in (value - half, value + further)]
    found, low, high = (float(np.exp(v)) if coordinate.is_log else float(v) for v in (value, *ends))
    return Estimate(found, (low, high), unit)


def _base_estimates(
    fit: Fit, covariance: np.ndarray[Any, np.dtype[np.float64]], is_linear: bool
) -> dict[str, Estimate]:
    reach = _reach(fit.problem.series.blocks)
    variance = np.diag(covariance)
    found = {}
    for number, term in enumerate(fit.terms):
        if term.slug in _FARTHEST:
            at = fit.columns(number).start
            half, unit = reach * float(np.sqrt(variance[at])), unit_of(f"plant.{term.slug}", is_linear)
            found[term.slug] = _estimate(term.coordinates[0], float(fit.u[at]), half, unit)
    return found


def _timing(recordings: Sequence[Recording]) -> dict[str, Any]:
    waits = [np.diff(recording.time_s) / recording.period_s for recording in recordings]
    regular = [w[w < 1.5] * recording.period_s for w, recording in zip(waits, recordings, strict=True)]
    return {
        "missed": int(sum(np.sum(np.rint(w[w >= 1.5]) - 1) for w in waits)),
        "jitter_s": float(max(np.std(w) for w in regular)),
        "period_s": float(np.median([recording.period_s for recording in recordings])),
        "warnings": [warning for recording in recordings for warning in recording.warnings],
    }


def _profiles(recordings: Sequence[Recording], fit: Fit, before: Missing, after: Missing) -> tuple[Profile, ...]:
    series = fit.problem.series
    found = []
    for number, recording in enumerate(recordings):
        rows = series.recording == number
        found.append(
            Profile(
                recording.name,
                series.time_s[rows],
                after.position[rows],
                after.velocity[rows],
                series.command[rows],
                after.moves[rows],
                before.force[rows],
                after.force[rows],
                np.sqrt(after.variance[rows]),
            )
        )
    return tuple(found)
