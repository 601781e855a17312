"""The result of a search: named effects with intervals, the missing force before and after, and the remainder."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.config import unit_of
from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import chance, grip, late_record, missing
from hapticd.gap.base_model import at_the_end
from hapticd.gap.covariance import covariance_of
from hapticd.gap.kernel.ticks import NOISE
from hapticd.gap.law_set import is_at_noise_level
from hapticd.gap.missing import Missing, missing_force
from hapticd.gap.model_file import BASE_KEYS
from hapticd.gap.prediction import predicted, prediction_errors
from hapticd.gap.profile import Profile
from hapticd.gap.remainder import remainder_of
from hapticd.gap.result import Estimate, GapNumbers, GapResult, Ranked, Step
from hapticd.gap.terms import BASE_WORDS, Coordinate, Term, parameters_of_term, whole_turns
from hapticd.gap.validation import validate
from hapticd.gap.verdict import decide, doubts_about
from hapticd.plant.layout import NAMES, index_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from hapticd.config import Config
    from hapticd.gap.arrays import Floats
    from hapticd.gap.choose import Named, Search
    from hapticd.gap.fit import Fit
    from hapticd.gap.law_set import LawSet
    from hapticd.gap.recording import Recording


def answer(
    recordings: Sequence[Recording],
    model: Config,
    search: Search,
    chosen: LawSet,
    named: Sequence[Named],
    *,
    are_all: bool,
    unnamed: Mapping[str, str],
    validation: Recording | None = None,
) -> GapResult:
    """The result, computed with a disturbance that may be slow.

    Args:
        recordings: the fitted recordings. model: the nominal model. search: the search.
        chosen: the set of laws. named: its laws, in the order of the report.
        are_all: whether the whole catalogue was considered. unnamed: law that was dropped to the coordinate of the unnamed
            function that replaced it.
        validation: a recording that was not fitted.
    """
    freed = [one.with_slow_disturbance for one in path(search, chosen, named)]
    after = missing.held_out_rms(freed[-1].fit)
    torque = missing.own_torque(freed[-1].fit)
    if named and after > torque:  # the model is of another device
        named, freed = (), freed[:1]
        after, torque = missing.held_out_rms(freed[0].fit), missing.own_torque(freed[0].fit)
    first, last = freed[0], freed[-1]
    found = [missing_force(one.fit) for one in freed]
    power = [each.rms**2 for each in found]
    before = missing.held_out_rms(first.fit) if named else after
    unit = "N" if model.is_linear else "N m"
    numbers = GapNumbers(found[0].rms, found[-1].rms, before, after, missing.noise_floor(last.fit), unit)
    possible = max(missing.explainable(first.fit, found[0]) * power[0], power[0] - power[-1], 1e-300)
    covariance = covariance_of(last.fit)
    variance, coverage = np.diag(covariance), _coverage_factor(last.fit.problem.series.blocks)
    edges = {
        at: ends
        for one in named
        if one.law == grip.SLUG
        for at, ends in grip.edge_ranges(last.fit, last.number(one.law)).items()
    }
    steps = tuple(
        _step(one, last, covariance, edges, model.is_linear, power[number : number + 2], possible)
        for number, one in enumerate(named)
    )
    effects = tuple(step.effect for step in steps)
    remainder = remainder_of(last.fit, found[-1], power[0])
    series, half = first.fit.problem.series, coverage * np.sqrt(variance)
    at_bounds = {
        one.law: names
        for one in named
        if (names := _at_bounds(last, one.law, half, edges)) and one.law not in BASE_WORDS
    }
    late = late_record.described(last.fit, variance, coverage)
    timing = _timing(recordings)
    assumed_friction = first.fit.problem.assumed_friction
    warnings = [
        *timing["warnings"],
        *late["warnings"],
        *_relative_to(assumed_friction, effects, model.is_linear),
        *([_held(search, model.is_linear)] if search.base.is_held else []),
        *_unsure(search.base.unsure(chosen), last.fit, model),
    ]
    timing = {**timing, **late, "warnings": warnings}
    doubts = [*doubts_about(at_bounds, unnamed), *at_the_end(last.fit, half, is_held=search.base.is_held)]
    ties = [step.indistinguishable_from for step in steps]
    own = [CATALOGUE[step.effect].equivalent_to for step in steps]
    untied = [tuple(slug for slug in tied if slug not in same) for tied, same in zip(ties, own, strict=True)]
    verdict, statement = decide(effects, untied, doubts, numbers, remainder, torque, are_all=are_all)
    noise = last.fit.noise_values()
    return GapResult(
        verdict,
        statement,
        effects,
        steps,
        numbers,
        remainder,
        where=tuple(
            {"coordinate": entry.coordinate, "range": list(entry.ends), "share": entry.share}
            for entry in missing.dependences(first.fit, found[0])
        ),
        base=_base_estimates(last, effects, variance, coverage, model.is_linear),
        assumed_friction=assumed_friction,
        prediction=prediction_errors(predicted(first.fit), predicted(last.fit), model.is_linear),
        validation=validate(first.fit, last.fit, validation) if validation else None,
        recording=timing,
        details={
            "samples": series.size,
            "blocks": series.blocks,
            "candidates": list(search.slugs),
            "noise": dict(zip(NOISE, (float(value) for value in noise), strict=True)),
            "needed_standard_errors": search.sets.needed,
            "explainable_share": min(possible / power[0], 1.0) if power[0] > 0.0 else 0.0,
            "at_bounds": at_bounds,
            "predicted_better_by": dict(unnamed),
            "is_quiet": not named and is_at_noise_level(chosen.fit),
            "filter_runs": round(sum(first.fit.problem.runs) / series.size),
            "filter_runs_of_columns": round(sum(first.fit.problem.columns) / series.size),
        },
        profiles=_profiles(recordings, first.fit, found[0], found[-1]),
    )


def _held(search: Search, is_linear: bool) -> str:
    """Warning: the inertia was kept in the range that the balance of forces gives."""
    unit, held = unit_of("plant.inertia", is_linear), search.base.balance.inertia
    between = f"between {held.low:.3g} and {held.high:.3g} {unit}" if held else ""
    return (
        f"inertia: kept {between}, the range that least squares on the balance of forces gives. Another inertia predicts "
        "better one step ahead, but leaves more force missing. Record a faster motion to decide"
    )


def _unsure(slugs: Sequence[str], fit: Fit, model: Config) -> list[str]:
    """Warning: base parameters that are free in the fit and not named."""
    found = []
    for slug in slugs:
        name = BASE_WORDS[slug]
        value, unit = float(fit.device()[index_of(name)]), unit_of(f"plant.{name}", model.is_linear)
        found.append(f"{name} {value:.4g} instead of {getattr(model.plant, name):.4g} {unit}")
    if not found:
        return []
    values = ", ".join(found)
    return [f"the data are likelier with {values}. It is in the fit, but not sure: the improved model does not have it"]


def path(search: Search, chosen: LawSet, named: Sequence[Named]) -> list[LawSet]:
    """The model as given, then with one more law of the set each."""
    sets = [chosen]
    for one in reversed(named[1:]):
        sets.insert(0, search.sets.without(sets[0], one.law))
    return [search.sets.given, *sets] if named else [search.sets.given]


def _at_bounds(laws: LawSet, slug: str, half: Floats, edges: Mapping[int, tuple[float, float]]) -> list[str]:
    """Parameters whose 95 % interval reaches the end of their range; for the edges of a grip, the end of the recording."""
    fit, number = laws.fit, laws.number(slug)
    law, own = fit.terms[number], fit.columns(number)
    names = law.at_bounds(fit.u[own], half[own])
    duration_s = fit.problem.series.duration_s
    return [
        c.name
        for at, c in enumerate(law.coordinates, own.start)
        if (edges[at][0] <= 0.0 or edges[at][1] >= duration_s if at in edges else c.name in names)
    ]


def _relative_to(assumed_friction: Mapping[str, float], effects: Sequence[str], is_linear: bool) -> list[str]:
    """Warnings: the reference value of each relative correction of a friction that is 0 in the model."""
    keys = {slug: ".".join(BASE_KEYS[slug]) for slug in effects if slug in BASE_KEYS}
    sizes = {f"plant.{name}": size for name, size in assumed_friction.items()}
    return [
        f"{key} of the model is 0: r of {slug} is relative to {sizes[key]:.3g} {unit_of(key, is_linear)}"
        for slug, key in keys.items()
        if key in sizes
    ]


def _step(
    one: Named,
    last: LawSet,
    covariance: Floats,
    edges: Mapping[int, tuple[float, float]],
    is_linear: bool,
    power: Sequence[float],
    possible: float,
) -> Step:
    number = last.number(one.law)
    term, own = last.fit.terms[number], last.fit.columns(number)
    u, variance = last.fit.u[own], np.diag(covariance)[own]
    estimates = estimates_of(term, u, variance, last.fit.problem.series.blocks, is_linear)
    for at, coordinate in enumerate(term.coordinates, own.start):
        if at in edges:
            estimates[coordinate.name] = replace(estimates[coordinate.name], ci95=edges[at])
    same = CATALOGUE[one.law].equivalent_to
    own_rank = Ranked(one.law, one.comparison.gain, one.comparison.errors, 0.0)
    ranking = (own_rank, *(Ranked(*rival) for rival in one.ranked))
    return Step(
        one.law,
        estimates,
        float(np.sqrt(power[0])),
        float(np.sqrt(power[1])),
        float(np.clip((power[0] - power[1]) / possible, 0.0, 1.0)),
        one.comparison.errors,
        one.comparison.gain,
        (*same, *(tie.laws[-1] for tie in one.ties if tie.laws[-1] not in same)),
        ranking,
        parameters_of_term(term, u),
    )


def _coverage_factor(blocks: int) -> float:
    """Coverage factor of a 95 % interval: its half width in standard errors (Student's distribution)."""
    return chance.standard_errors(0.025, blocks)


def estimates_of(
    term: Term, u: np.ndarray[Any, np.dtype[np.float64]], variance: np.ndarray[Any, Any], blocks: int, is_linear: bool
) -> dict[str, Estimate]:
    """Parameters of a term with their 95 % intervals.

    Args:
        term: the law. u: (k,) its coordinates. variance: (k,) their variances.
        blocks: number of blocks. is_linear: metres and newtons.
    """
    coverage = _coverage_factor(blocks)
    if term.slug in BASE_WORDS:
        (own,) = term.coordinates
        ends = _ends(own, float(u[0]), coverage * float(np.sqrt(variance[0])))
        value, low, high = (math.expm1(end - own.centre) for end in (float(u[0]), *ends))
        return {"r": Estimate(value, (low, high), "")}
    units = {p.name: p.unit_linear if is_linear else p.unit for p in CATALOGUE[term.slug].parameters}
    found = {}
    for index, chosen in term.fixed:
        name = NAMES[index].partition(".")[2]
        found[name] = Estimate(chosen, (chosen, chosen), units[name.partition("[")[0]])
    accuracy = CATALOGUE[term.slug].accuracy
    for coordinate, value, own in zip(term.coordinates, u, variance, strict=True):
        model = accuracy if coordinate.is_log else accuracy * abs(value)
        half = coverage * math.hypot(float(np.sqrt(own)), model)
        name = coordinate.name.partition("[")[0]
        estimate = _estimate(coordinate, value, half, units[name])
        turns = whole_turns(term.slug, name, estimate.value)
        low, high = estimate.ci95
        found[coordinate.name] = Estimate(estimate.value - turns, (low - turns, high - turns), estimate.unit)
    return found


def _estimate(coordinate: Coordinate, value: float, half: float, unit: str) -> Estimate:
    """The estimate with coordinate `value` ± `half`, limited to its bounds."""
    ends = _ends(coordinate, value, half)
    found, low, high = (float(np.exp(v)) if coordinate.is_log else float(v) for v in (value, *ends))
    return Estimate(found, (low, high), unit)


def _ends(coordinate: Coordinate, value: float, half: float) -> tuple[float, float]:
    # Near zero the interval of the logarithm has no useful upper end: the interval of the value has.
    further = math.log1p(half) if coordinate.is_log and value <= coordinate.lower else half
    low, high = (min(max(end, coordinate.lower), coordinate.upper) for end in (value - half, value + further))
    return low, high


def _base_estimates(
    last: LawSet, effects: Sequence[str], variance: Floats, coverage: float, is_linear: bool
) -> dict[str, Estimate]:
    """Base parameters outside their prior, in the units of the model."""
    found = {}
    for slug in effects:
        if slug in BASE_WORDS:
            name, number = BASE_WORDS[slug], last.number(slug)
            at = last.fit.columns(number).start
            half, unit = coverage * float(np.sqrt(variance[at])), unit_of(f"plant.{name}", is_linear)
            coordinate = last.fit.terms[number].coordinates[0]
            found[name] = _estimate(coordinate, float(last.fit.u[at]), half, unit)
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
