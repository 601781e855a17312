"""The first screen of the report answers: what is missing, where it shows, how sure, how far the gap shrank."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import pytest

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap.consequences import consequences
from hapticd.gap.data import Recording
from hapticd.gap.report import page
from hapticd.gap.result import Estimate, GapNumbers, GapResult, Step
from hapticd.gap.structure import Dependence, Structure

from .synthetic import model

PLACE = {
    "coordinate": "speed",
    "range": [None, 2.0],
    "share": 0.62,
    "unit": "rad/s",
    "words": "62 % sits below 2 rad/s",
}
STEP = Step(
    "stribeck",
    {"s": Estimate(0.412, (0.38, 0.44), ""), "omega_s": Estimate(1.5, (1.2, 1.9), "rad/s")},
    gap_before=2.31,
    gap_after=1.04,
    evidence=9.8,
    log_likelihood_gain=400.0,
    indistinguishable_from=(),
    ranking=(),
)
NOISE = Structure((Dependence("position", 0.41, 0.002),), 20)
FOUND = GapResult(
    "effect_found",
    "Missing: stribeck (gap 1.04 with it).",
    ("stribeck",),
    (STEP,),
    GapNumbers(2.3, 1.02, 2.31, 1.04, 1e-4),
    residual_structure=NOISE.to_json(),
    where=(PLACE,),
    warnings=("lab.csv: the motion goes one way",),
    details={"windows": 1, "blocks": 1, "candidates": list(CATALOGUE)},
)


def first_screen(result: GapResult, run: Recording) -> str:
    """Text of the page up to its first figure."""
    changes: dict[str, Any] = consequences(model(), model(), 0.0)
    whole = page(
        result, [run], model(), changes, {slug: spec.summary for slug, spec in CATALOGUE.items()}, "plant: {}\n"
    )
    assert "http://" not in re.sub(r"data:[^\"]*", "", whole)
    head = whole[whole.index("<h1>") : whole.index("<figure>")]
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", head))


def test_all_four_questions_are_answered_with_numbers(nominal_run: Recording) -> None:
    text = first_screen(FOUND, nominal_run)
    assert "Missing from the model: stribeck" in text
    assert "s = 0.412 (0.38 … 0.44)" in text
    assert "omega_s = 1.5 rad/s (1.2 … 1.9)" in text
    assert "62 % sits below 2 rad/s" in text
    assert "9.8 standard errors" in text
    assert "What is left looks like noise." in text
    assert "2.31 → 1.04" in text
    assert "the motion goes one way" in text


def test_a_tie_names_both_in_the_title(nominal_run: Recording) -> None:
    tied = replace(FOUND, verdict="ambiguous", steps=(replace(STEP, indistinguishable_from=("presliding",)),))
    text = first_screen(tied, nominal_run)
    assert "Missing: stribeck or presliding; these data leave open which" in text
    assert "do not tell it from presliding" in text


@pytest.mark.parametrize(
    ("tried", "words"), [(24, "Every effect of the catalogue was tried"), (1, "1 of the catalogue's 24")]
)
def test_nothing_missing_says_what_was_tried(nominal_run: Recording, tried: int, words: str) -> None:
    details = {**FOUND.details, "candidates": list(CATALOGUE)[:tried]}
    none = replace(FOUND, verdict="no_missing_effect", effects=(), steps=(), where=(), details=details)
    text = first_screen(none, nominal_run)
    assert "Nothing is missing from the model" in text
    assert words.replace("'", "&#39;") in text or words in text
    assert "no coordinate stands out" in text


def test_structure_that_is_left_is_said_first_thing(nominal_run: Recording) -> None:
    left = Structure((Dependence("position", 1e-4, 0.2, ", most between 0 and 1 rad"),), 20)
    text = first_screen(
        replace(FOUND, verdict="unexplained", structure=("position",), residual_structure=left.to_json()), nominal_run
    )
    assert "Something is missing that has no name here, beside stribeck" in text
    assert "What is left is no noise." in text
