"""Find where a model and recordings part, name what is missing, add it, and go round until nothing is left to name."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from hapticd.config.nearest import nearest_name
from hapticd.effects.catalogue import BROKEN, CATALOGUE, EFFECT_SLUGS
from hapticd.gap import late_record
from hapticd.gap.answer import answer
from hapticd.gap.base_model import NOTHING, base_terms, from_the_end, problem_of
from hapticd.gap.checks import check_together
from hapticd.gap.competition import Round, cross_validate
from hapticd.gap.corrections import CORRECTIONS
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.parallel import one_blas_thread
from hapticd.gap.problem import LEAST_START
from hapticd.gap.search import search

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hapticd.config import Config
    from hapticd.gap.recording import Recording
    from hapticd.gap.result import GapResult


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
        RecordingError: a recording is there twice.
        ValueError: no recording, a candidate that is unknown, or none that can be looked for.
        KeyboardInterrupt: interrupted before an effect was named; afterwards the result has what was found until then.
    """
    slugs, not_considered = considered(model, candidates, refit_base=refit_base)
    progress = progress or (lambda fraction, text: None)
    progress(0.0, "fitting the model as given")
    check_together(recordings)
    problem = problem_of(recordings, model, LEAST_START if refit_base else NOTHING)
    base = base_terms(problem) if refit_base else ()
    first = cross_validate(nominal_fit(problem, base))
    rounds: list[Round] = []
    interrupted, unnamed = False, None
    kept = first, base, tuple(rounds)  # of the search from the guess
    try:
        while True:
            unnamed = search(first, slugs, progress, rounds)
            last = rounds[-1].taken.judged.fit if rounds else first.fit
            farther = from_the_end(first.fit, last)
            late = [term for term in base if term.slug == late_record.SLUG]
            if rounds and late_record.is_late(law := rounds[-1].taken.law):
                late.append(late_record.along(law))
                untouched = late_record.untouched(slugs, law)
                not_considered += late_record.not_told(slugs, untouched) if candidates else []
                slugs = untouched
            elif farther is None:
                break
            else:
                kept = first, base, tuple(rounds)
            problem = farther or problem
            beside = (*(base_terms(problem, last.filter_s()) if refit_base else ()), *late)
            first, base = cross_validate(nominal_fit(problem, beside)), beside
            rounds.clear()
    except KeyboardInterrupt:
        if rounds and late_record.is_late(rounds[-1].taken.law):
            rounds.pop()  # no effect, and not yet fitted along
        if not rounds:
            first, base, rounds[:] = kept
        if not rounds:
            raise
        interrupted = True
    progress(0.9, "what is left")
    found = recordings, model, first, rounds, slugs, len(base), unnamed
    tell, named = partial(answer, *found, are_all=candidates is None), tuple(rounds)
    try:
        result = tell()
    except KeyboardInterrupt:
        if not named:
            raise
        rounds[:], interrupted = named, True
        result = tell()  # some seconds that what was named cannot do without
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


def why_unknown(slug: str) -> str | None:
    """Why the catalogue has no effect of that name, and which was probably meant; None where it has one."""
    if slug in CATALOGUE:
        return None
    near = nearest_name(slug, EFFECT_SLUGS)
    hint = f"; did you mean {near}?" if near else f" ({', '.join(EFFECT_SLUGS)})"
    return BROKEN.get(slug, f"not in the catalogue{hint}")


def considered(model: Config, candidates: Sequence[str] | None, *, refit_base: bool) -> tuple[list[str], list[str]]:
    """Effects that are looked for, and a sentence for each that was asked for and cannot be.

    Args:
        model: the nominal model. candidates: slugs that are asked for; None for the whole catalogue.
        refit_base: whether inertia and friction of the base model are fitted along.

    Raises:
        ValueError: one is unknown, or none can be looked for.
    """
    for slug in candidates or ():
        if reason := why_unknown(slug):
            raise ValueError(f"unknown effect {slug!r}: {reason}")
    chosen = EFFECT_SLUGS if candidates is None else [slug for slug in EFFECT_SLUGS if slug in candidates]
    reasons = {slug: reason for slug in chosen if (reason := _why_not(slug, model, refit_base))}
    left = [slug for slug in chosen if slug not in reasons]
    sentences = [f"{slug} cannot be looked for: {reason}" for slug, reason in reasons.items()]
    if candidates and not left:
        raise ValueError("; ".join(sentences))
    return left, sentences if candidates else []
