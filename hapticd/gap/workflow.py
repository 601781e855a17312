"""Find the effects that a model lacks, and add them one by one."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from hapticd.config.nearest import nearest_name
from hapticd.effects.catalogue import BROKEN, CATALOGUE, EFFECT_SLUGS
from hapticd.gap import constants, late_record
from hapticd.gap.answer import answer
from hapticd.gap.base_model import balanced, known_terms, problem_of
from hapticd.gap.checks import check_together
from hapticd.gap.choose import Search
from hapticd.gap.parallel import one_blas_thread
from hapticd.gap.terms import BASE_WORDS
from hapticd.gap.validation import check_validation

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hapticd.config import Config
    from hapticd.gap.choose import Named
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
    validation: Recording | None = None,
) -> GapResult:
    """Find the effects that a model lacks.

    Args:
        recordings: one or several runs of the same device.
        model: the nominal model.
        refit_base: fit inertia and friction even if `candidates` has none of them; without `candidates` they always are.
        candidates: slugs to consider; the whole catalogue by default.
        progress: called with the fraction done and the present step.
        design: whether to design an experiment for tied laws.
        validation: another run of the device, which is not fitted: both models are tested on it.

    Raises:
        RecordingError: a recording is given twice, or the one for validation is too short for a prediction.
        ValueError: no recording, an unknown candidate, or no candidate to consider.
        KeyboardInterrupt: interrupted before an effect was found; later, the result has what was found until then.
    """
    slugs, not_considered = considered(model, candidates)
    progress = progress or (lambda fraction, text: None)
    progress(0.0, "fitting the model as given")
    check_together(recordings)
    if validation:
        check_validation(recordings, validation)
    problem = problem_of(recordings, model)
    is_asked = candidates is not None
    if refit_base:
        slugs += [slug for slug in BASE_WORDS if slug not in slugs]
    search = Search(problem, slugs, known_terms(problem, model), balanced(recordings, model), is_asked=is_asked)
    chosen, unnamed, interrupted = search.sets.given, dict[str, str](), False
    try:
        for number, each in enumerate(search.rounds()):
            progress(min(0.8, number / (3.0 * constants.MOST_EFFECTS)), "trying effects")
            chosen = each.chosen
            if each.function:
                unnamed[each.law] = each.function
    except KeyboardInterrupt:
        if not chosen.laws:
            raise
        interrupted = True
    progress(0.9, "what is left")
    if interrupted:
        for change in search.base.settled(chosen):
            chosen = change.chosen
    if is_asked:
        not_considered += late_record.not_considered(slugs, search.slugs)

    def said() -> tuple[list[Named], GapResult]:
        named = search.named(chosen)
        result = answer(
            recordings, model, search, chosen, named, are_all=not is_asked, unnamed=unnamed, validation=validation
        )
        return named, result

    try:
        named, result = said()
    except KeyboardInterrupt:
        if not chosen.laws:
            raise
        interrupted = True
        named, result = said()  # some seconds, also after an interrupt: the found effects need it
    if design and result.verdict == "ambiguous" and not interrupted:
        from hapticd.gap.design import next_experiment

        try:
            planned = next_experiment(
                model, chosen, named, lambda fraction, text: progress(0.92 + 0.08 * fraction, text)
            )
            result = replace(result, next_experiment=planned)
        except KeyboardInterrupt:
            interrupted = True
    progress(1.0, "done")
    result.recording["warnings"].extend([*not_considered, *(validation.warnings if validation else ())])
    if interrupted:
        result = replace(result, interrupted=True, statement=f"Interrupted: {result.statement}")
    return result


def _why_not(slug: str, model: Config) -> str | None:
    """Why an effect cannot be considered, or None."""
    present = {effect.name for effect in model.plant.effects}
    if model.is_linear and CATALOGUE[slug].rotary_only:
        return "its law is in an angle, and the device is linear"
    if slug in present:
        return "the model has it already"
    if among := present & set(CATALOGUE[slug].excludes):
        return f"the model has {among.pop()}, which excludes it"
    return None


def why_unknown(slug: str) -> str | None:
    """Why a slug is not in the catalogue, with the nearest slug; None if it is."""
    if slug in CATALOGUE:
        return None
    near = nearest_name(slug, EFFECT_SLUGS)
    hint = f"; did you mean {near}?" if near else f" ({', '.join(EFFECT_SLUGS)})"
    return BROKEN.get(slug, f"not in the catalogue{hint}")


def considered(model: Config, candidates: Sequence[str] | None) -> tuple[list[str], list[str]]:
    """Effects to consider, and a sentence for each requested effect that cannot be.

    Args:
        model: the nominal model. candidates: requested slugs; None for the whole catalogue.

    Raises:
        ValueError: one is unknown, or none can be considered.
    """
    for slug in candidates or ():
        if reason := why_unknown(slug):
            raise ValueError(f"unknown effect {slug!r}: {reason}")
    chosen = EFFECT_SLUGS if candidates is None else [slug for slug in EFFECT_SLUGS if slug in candidates]
    reasons = {slug: reason for slug in chosen if (reason := _why_not(slug, model))}
    left = [slug for slug in chosen if slug not in reasons]
    sentences = [f"{slug} cannot be considered: {reason}" for slug, reason in reasons.items()]
    if candidates and not left:
        raise ValueError("; ".join(sentences))
    return left, sentences if candidates else []
