"""From what a search found to what is told of it: names with intervals, the missing force before and after, what is left."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.config import unit_of
from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import chance, grip, late_record, missing
from hapticd.gap.base_model import FARTHEST, not_told
from hapticd.gap.competition import ROUGH, CrossValidated, Round, better_function, evidence
from hapticd.gap.covariance import covariance_of
from hapticd.gap.kernel.ticks import NOISE
from hapticd.gap.missing import Missing, missing_force
from hapticd.gap.model_file import BASE_KEYS
from hapticd.gap.prediction import prediction_errors
from hapticd.gap.profile import Profile
from hapticd.gap.remainder import remainder_of
from hapticd.gap.result import Estimate, GapNumbers, GapResult, Ranked, Step
from hapticd.gap.search import critical, is_quiet, least_gain, withstanding
from hapticd.gap.terms import Coordinate, Term, parameters_of_term
from hapticd.gap.verdict import decide, doubts_about
from hapticd.plant.layout import NAMES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from hapticd.config import Config
    from hapticd.gap.fit import Fit
    from hapticd.gap.recording import Recording


def answer(
    recordings: Sequence[Recording],
    model: Config,
    first: CrossValidated,
    rounds: list[Round],
    slugs: Sequence[str],
    fixed: int,
    unnamed: str | None,
    *,
    are_all: bool,
) -> GapResult:
    """What a search found, judged beside a disturbance that may be slow.

    Args:
        recordings: what was searched. model: the nominal model. first: its fit.
        rounds: of the search; what is no more than a slow disturbance is taken out.
        slugs: effects that competed. fixed: terms that come before the effects.
        unnamed: an effect that predicts better for sure and was not named.
        are_all: whether the whole catalogue was looked for.
    """
    quiet, sure = not rounds and is_quiet(first.fit), [each.taken.slug for each in rounds]
    # What was found is judged with a disturbance that may be slow: nothing is missing that it could be.
    freed = withstanding(first, rounds, len(slugs))
    after = missing.held_out_rms(freed[-1].fit)
    while rounds and after > missing.own_torque(freed[-1].fit):
        del rounds[-1], freed[-1]  # a model of another device names nothing
        after = missing.held_out_rms(freed[-1].fit)
    first, last = freed[0], freed[-1]
    found = [missing_force(judged.fit) for judged in freed]
    power = [each.rms**2 for each in found]
    before = missing.held_out_rms(first.fit) if rounds else after
    unit = "N" if model.is_linear else "N m"
    numbers = GapNumbers(found[0].rms, found[-1].rms, before, after, missing.noise_floor(last.fit), unit)
    possible = max(missing.explainable(first.fit, found[0]) * power[0], power[0] - power[-1], 1e-300)
    covariance = covariance_of(last.fit)
    grips = [fixed + number for number, each in enumerate(rounds) if each.taken.slug == grip.SLUG]
    edges = {at: ends for number in grips for at, ends in grip.edge_ranges(last.fit, number).items()}
    steps = tuple(
        _step(each, number, last.fit, covariance, edges, fixed, model.is_linear, power, possible)
        for number, each in enumerate(rounds)
    )
    effects = tuple(step.effect for step in steps)
    indistinguishable = [each.indistinguishable for each in rounds]
    remainder = remainder_of(last.fit, found[-1], power[0])
    laws = [(last.fit.terms[number], last.fit.columns(number)) for number in range(fixed, fixed + len(rounds))]
    tolerance = ROUGH * least_gain(critical(first.held_out.size, len(slugs)))
    beaten = {
        law.slug: coordinate
        for (law, _), before_it, with_it in zip(laws, freed, freed[1:], strict=False)
        if not is_quiet(last.fit)
        and (coordinate := better_function(before_it, with_it, len(law.coordinates), tolerance)) is not None
    }
    series = first.fit.problem.series
    half = _reach(series.blocks) * np.sqrt(np.diag(covariance))
    at_bounds = {law.slug: names for law, own in laws if (names := _at_bounds(law, own, last.fit, half, edges))}
    late = late_record.described(last.fit, np.diag(covariance), _reach(series.blocks))
    timing = _timing(recordings)
    begun = first.fit.problem.begun
    warnings = [
        *timing["warnings"],
        *late["warnings"],
        *_relative_to(begun, effects, model.is_linear),
    ]
    timing = {**timing, **late, "warnings": warnings}
    doubts = [*doubts_about(at_bounds, beaten, unnamed), *not_told(last.fit, half)]
    torque = missing.own_torque(last.fit)
    verdict, statement = decide(effects, indistinguishable, doubts, numbers, remainder, torque, are_all=are_all)
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
            "taken_back": [slug for slug in sure if slug not in effects],
            "likelihood_evaluations": len(first.fit.problem.runs),
        },
        profiles=_profiles(recordings, first.fit, found[0], found[-1]),
    )


def _at_bounds(
    law: Term,
    own: slice,
    fit: Fit,
    half: np.ndarray[Any, np.dtype[np.float64]],
    edges: Mapping[int, tuple[float, float]],
) -> list[str]:
    """Parameters that are not told from the end of their range; of a grip's edges that is the recording's."""
    names = law.at_bounds(fit.u[own], half[own])
    duration_s = fit.problem.series.duration_s
    return [
        c.name
        for at, c in enumerate(law.coordinates, own.start)
        if (edges[at][0] <= 0.0 or edges[at][1] >= duration_s if at in edges else c.name in names)
    ]


def _relative_to(begun: Mapping[str, float], effects: Sequence[str], is_linear: bool) -> list[str]:
    """What corrections of frictions that the model has not are relative to."""
    keys = {slug: ".".join(BASE_KEYS[slug]) for slug in effects if slug in BASE_KEYS}
    sizes = {f"plant.{name}": size for name, size in begun.items()}
    return [
        f"{key} of the model is 0: r of {slug} is relative to {sizes[key]:.3g} {unit_of(key, is_linear)}"
        for slug, key in keys.items()
        if key in sizes
    ]


def _step(
    each: Round,
    number: int,
    fit: Fit,
    covariance: np.ndarray[Any, np.dtype[np.float64]],
    edges: Mapping[int, tuple[float, float]],
    fixed: int,
    is_linear: bool,
    power: Sequence[float],
    possible: float,
) -> Step:
    taken = each.taken
    term, own = fit.terms[fixed + number], fit.columns(fixed + number)
    u, variance = fit.u[own], np.diag(covariance)[own]
    blocks = fit.problem.series.blocks
    estimates = estimates_of(term, u, variance, blocks, is_linear)
    for at, coordinate in enumerate(term.coordinates, own.start):
        if at in edges:
            estimates[coordinate.name] = replace(estimates[coordinate.name], ci95=edges[at])
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


def estimates_of(
    term: Term, u: np.ndarray[Any, np.dtype[np.float64]], variance: np.ndarray[Any, Any], blocks: int, is_linear: bool
) -> dict[str, Estimate]:
    """Parameters of a term with their 95 % intervals.

    Args:
        term: the law. u: (k,) its coordinates. variance: (k,) of these.
        blocks: of the recordings. is_linear: metres and newtons.
    """
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
        if term.slug in FARTHEST:
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
