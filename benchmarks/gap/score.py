"""Answers against the truth, case by case; nothing here is seen by the workflow.

What counts:

* ``right``: found, and the first effect named is the hidden one, or one of its exact class with the class reported;
  or "ambiguous" with the hidden effect among the names and every other name in its exact class or a near-tie of it.
* ``wrong``: found, and the first name is another.
* ``vague``: "ambiguous" without the hidden effect, or with a name that is no near-tie.
* ``unexplained`` and ``missed`` (nothing is missing, it says), ``failed`` (an error).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks.gap.plan import NEAR_TIES, exact_class

Answer = dict[str, Any]
Truth = dict[str, Any]

OUTCOMES = ("right", "wrong", "vague", "unexplained", "missed", "failed")


@dataclass(frozen=True)
class Rate:
    """So many of so many, with the Wilson interval of 95 %."""

    hits: int
    of: int

    @property
    def value(self) -> float:
        """The share; NaN of nothing."""
        return self.hits / self.of if self.of else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson score interval (Wilson 1927) for 95 %."""
        if not self.of:
            return (0.0, 1.0)
        z, n, p = 1.959964, self.of, self.value
        centre = (p + z * z / (2 * n)) / (1 + z * z / n)
        half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
        return (max(0.0, centre - half), min(1.0, centre + half))

    def __str__(self) -> str:
        if not self.of:
            return "-"
        low, high = self.interval
        return f"{100 * self.value:.1f} % ({self.hits}/{self.of}; {100 * low:.1f}–{100 * high:.1f})"


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


def outcome(answer: Answer, hidden: str) -> str:
    """One of `OUTCOMES` for a case with one hidden effect."""
    if "error" in answer:
        return "failed"
    verdict = answer["verdict"]
    if verdict == "no_missing_effect":
        return "missed"
    if verdict == "unexplained":
        return "unexplained"
    if verdict == "effect_found":
        return "right" if names_it(answer, answer["effects"][0], hidden) else "wrong"
    named = names_of(answer)
    return "right" if hidden in named and all(near(hidden, name) for name in named) else "vague"


def both_named(answer: Answer, hidden: Sequence[str]) -> bool:
    """Whether an answer names both of two hidden effects, and ties only where they are near."""
    if "error" in answer or answer["verdict"] not in ("effect_found", "ambiguous"):
        return False
    if answer["verdict"] == "effect_found":
        return all(any(names_it(answer, named, slug) for named in answer["effects"]) for slug in hidden)
    named = names_of(answer)
    return all(slug in named for slug in hidden) and all(any(near(slug, name) for slug in hidden) for name in named)


def confident_wrong(answer: Answer, hidden: Sequence[str]) -> bool:
    """Whether an answer is sure, and its first name is none of the hidden effects."""
    if answer.get("verdict") != "effect_found":
        return False
    return not any(names_it(answer, answer["effects"][0], slug) for slug in hidden)


def first_name(answer: Answer) -> str:
    """The column of the confusion matrix."""
    if "error" in answer:
        return "failed"
    if answer["verdict"] == "effect_found":
        return str(answer["effects"][0])
    return str(answer["verdict"])


def _pairs(true: Any, found: dict[str, Any]) -> list[tuple[float, float, float]]:
    """True value and interval of one parameter, element by element where it is a list."""
    interval = found.get("ci95")
    if interval is None or isinstance(true, list):
        return []
    low, high = (float(bound) if bound is not None else math.nan for bound in interval)
    return [(float(true), low, high)] if math.isfinite(low) and math.isfinite(high) else []


def inside(answer: Answer, truth: Truth) -> list[tuple[str, bool]]:
    """Every parameter of a rightly named single effect, and whether its 95 % interval holds the true value.

    A bias named for an asymmetric friction, or the reverse, is compared through τ₀ = −a c. Orders of a ripple are matched
    by number, amplitude by amplitude.
    """
    effect = truth["effects"][0]
    step = next((s for s in answer.get("steps", []) if names_it(answer, s["effect"], effect["name"])), None)
    if step is None:
        return []
    wanted = {key: value for key, value in effect.items() if key != "name"}
    if step["effect"] != effect["name"]:
        wanted = (
            {"tau_0": -effect["a"] * truth["coulomb"]} if "a" in effect else {"a": -effect["tau_0"] / truth["coulomb"]}
        )
    found = _ripple(step["parameters"], wanted) if effect["name"] == "torque_ripple" else step["parameters"]
    if effect["name"] == "torque_ripple":
        wanted = {f"amplitude of order {k:g}": a for k, a in zip(wanted["orders"], wanted["amplitudes"], strict=True)}
    return [
        (name, low <= true <= high)
        for name, value in wanted.items()
        if name in found
        for true, low, high in _pairs(value, found[name])
    ]


def _ripple(parameters: dict[str, Any], wanted: dict[str, Any]) -> dict[str, Any]:
    """Amplitudes by order, from parameters that are lists or numbered (``amplitudes[0]``)."""
    found = {}
    for order in wanted["orders"]:
        for index, value in enumerate(_listed(parameters, "orders", "value")):
            if abs(value - order) < 0.25:
                amplitude = _listed(parameters, "amplitudes", "ci95")
                found[f"amplitude of order {order:g}"] = {"ci95": amplitude[index]}
    return found


def _listed(parameters: dict[str, Any], name: str, key: str) -> list[Any]:
    if name in parameters:
        value = parameters[name][key]
        return list(value) if isinstance(value, list) else [value]
    return [entry[key] for full, entry in parameters.items() if full.startswith(f"{name}[")]


SIZE_PARAMETERS = {
    "r", "a", "s", "breakaway", "d", "kappa", "tau_0", "m_g_l", "k_s", "t_d", "f_a", "i_max", "q", "gap", "f_r", "e", "p",
    "m_h", "b_h", "k_h",
}  # fmt: skip
"""What measures an effect's size; the others are its shape."""
