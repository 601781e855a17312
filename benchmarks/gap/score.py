"""Answers against the truth, case by case; nothing here is seen by the workflow.

What an answer is for one hidden effect:

* ``right``: the first name is the hidden effect, or one of its exact class with the class reported, with the verdict
  "effect_found" or "partly_explained".
* ``tied``: "ambiguous", and the first name is the hidden effect; or it is a near-tie of it, and the hidden one is among
  the names. It counts as named.
* ``wrong``: "effect_found" with another first name.
* ``partly``, ``vague``, ``unexplained``, ``missed``: "partly_explained" or "ambiguous" with another name, structure without
  a name, nothing missing. The answer abstains.
* ``late``, ``failed``: no answer in time, an error.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.gap.plan import BASE_ERRORS, NEAR_TIES, exact_class

Answer = dict[str, Any]
Truth = dict[str, Any]

OUTCOMES = ("right", "tied", "wrong", "partly", "vague", "unexplained", "missed", "late", "failed")
NAMED = ("right", "tied")
_SILENT = {"no_missing_effect": "missed", "unexplained": "unexplained"}
_HEDGED = {"partly_explained": "partly", "ambiguous": "vague"}


def verdict_of(answer: Answer) -> str:
    """The verdict, or why there is none."""
    if "late" in answer:
        return "late"
    return "failed" if "error" in answer else str(answer["verdict"])


def near(slug: str, other: str) -> bool:
    """Whether both are one exact class or a near-tie."""
    return other in exact_class(slug) or frozenset({slug, other}) in NEAR_TIES


def names_of(answer: Answer) -> list[str]:
    """Every effect that an answer names, its ties included, the first first."""
    named = list(answer.get("effects", []))
    for step in answer.get("steps", []):
        named += [step["effect"], *step.get("indistinguishable_from", [])]
    return list(dict.fromkeys(named))


def _reported_with(answer: Answer, slug: str) -> set[str]:
    """What the step that added an effect calls indistinguishable from it."""
    steps = [step for step in answer.get("steps", []) if step["effect"] == slug]
    return {name for step in steps for name in step.get("indistinguishable_from", [])}


def names_it(answer: Answer, named: str, hidden: str) -> bool:
    """Whether a name is the hidden effect, or one of its exact class with the class reported."""
    return named == hidden or (named in exact_class(hidden) and hidden in _reported_with(answer, named))


def _names_one(answer: Answer, named: str, hidden: Sequence[str]) -> bool:
    return any(names_it(answer, named, slug) for slug in hidden)


def outcome(answer: Answer, hidden: Sequence[str]) -> str:
    """One of `OUTCOMES`: what the first name is to the hidden effects."""
    verdict = verdict_of(answer)
    if verdict in ("late", "failed"):
        return verdict
    if verdict in _SILENT:
        return _SILENT[verdict]
    effects = answer["effects"]
    first = bool(effects) and _names_one(answer, effects[0], hidden)
    if verdict == "ambiguous":
        tied = bool(effects) and any(near(slug, effects[0]) and slug in names_of(answer) for slug in hidden)
        return "tied" if first or tied else _HEDGED[verdict]
    if first:
        return "right"
    return _HEDGED.get(verdict, "wrong")


def is_named(answer: Answer, hidden: Sequence[str]) -> bool:
    """Whether the first name is a hidden effect."""
    return outcome(answer, hidden) in NAMED


def all_named(answer: Answer, hidden: Sequence[str]) -> bool:
    """Whether an answer names each of the hidden effects, in any order; where it is ambiguous, its ties count."""
    if verdict_of(answer) not in ("effect_found", "partly_explained", "ambiguous"):
        return False
    if answer["verdict"] == "ambiguous":
        return set(hidden) <= set(names_of(answer))
    return all(any(names_it(answer, named, slug) for named in answer["effects"]) for slug in hidden)


def wrong_further(answer: Answer, hidden: Sequence[str]) -> list[str]:
    """Effects named after the first one that are not hidden."""
    return [named for named in answer.get("effects", [])[1:] if not _names_one(answer, named, hidden)]


def confident_wrong(answer: Answer, hidden: Sequence[str]) -> bool:
    """Whether an answer is sure, and its first name is none of the hidden effects nor part of what equals one of them.

    Three base parameters that are wrong by one factor are the fourth one: named together they are no wrong name.
    """
    if outcome(answer, hidden) != "wrong":
        return False
    return not any(set(BASE_ERRORS) - {slug} <= set(answer["effects"]) for slug in hidden if slug in BASE_ERRORS)


def is_alarm(answer: Answer) -> bool:
    """Whether an answer on a device without a hidden effect is anything but "nothing is missing"."""
    return verdict_of(answer) != "no_missing_effect"


def first_name(answer: Answer) -> str:
    """The column of the confusion matrix: a name with "effect_found", otherwise the verdict."""
    verdict = verdict_of(answer)
    return str(answer["effects"][0]) if verdict == "effect_found" and answer["effects"] else verdict
