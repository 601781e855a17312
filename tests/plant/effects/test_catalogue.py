"""The catalogue is complete, says the same as the config and the documentation, and its relations go both ways."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import yaml
from hapticd.config.effect_parameters import EFFECT_PARAMETERS

from hapticd.config import EFFECT_SLUGS, parse_config
from hapticd.config.text import bound_text
from hapticd.effects.catalogue import CATALOGUE

DOCS = Path(__file__).parents[3] / "docs" / "effects"


def _words(text: str) -> str:
    return " ".join(text.split())


def test_every_slug_has_one_entry_and_one_page() -> None:
    assert tuple(CATALOGUE) == EFFECT_SLUGS
    assert len(EFFECT_SLUGS) == 24
    assert {page.stem for page in DOCS.glob("*.md")} == {*EFFECT_SLUGS, "README"}


@pytest.mark.parametrize("slug", EFFECT_SLUGS)
def test_an_entry_is_consistent(slug: str) -> None:
    effect = CATALOGUE[slug]
    assert effect.slug == slug
    assert effect.parameters == EFFECT_PARAMETERS[slug]
    for other in effect.equivalent_to:
        assert slug in CATALOGUE[other].equivalent_to
    assert {*effect.near, *effect.equivalent_to} <= set(EFFECT_SLUGS) - {slug}
    for parameter in effect.parameters:
        assert parameter.lower < parameter.upper < math.inf
        assert parameter.lower <= parameter.neutral
        assert parameter.lower >= 0.0 or parameter.scale == "linear"


@pytest.mark.parametrize("slug", EFFECT_SLUGS)
def test_a_page_says_what_the_catalogue_says(slug: str) -> None:
    effect, page = CATALOGUE[slug], (DOCS / f"{slug}.md").read_text()
    for text in (effect.summary, effect.law, effect.source, effect.where_it_shows):
        assert _words(text) in _words(page)
    for parameter in effect.parameters:
        (row,) = [line for line in page.splitlines() if line.startswith(f"| `{parameter.name}`")]
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        assert cells[1:3] == [parameter.unit or "number", parameter.unit_linear or "number"]
        assert cells[4] == f"{bound_text(parameter.lower)} … {bound_text(parameter.upper)}"
    for other in (*effect.near, *effect.equivalent_to):
        assert f"]({other}.md)" in page
    example = page.split("```yaml\n")[1].split("```")[0]
    assert parse_config(yaml.safe_load(example), "page").plant.effects[0].name == slug


def test_the_table_lists_every_effect_with_its_law() -> None:
    table = (DOCS / "README.md").read_text()
    for slug, effect in CATALOGUE.items():
        law = effect.law.replace("|", "\\|")
        names = ", ".join(f"`{parameter.name}`" for parameter in effect.parameters)
        assert f"| [{slug}]({slug}.md) | {law} | {names} |" in table
