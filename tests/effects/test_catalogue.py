"""The catalogue is complete and consistent, its relations go both ways, and the documentation is what is made of it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from hapticd.config import EFFECT_SLUGS, parse_config
from hapticd.effects import Effect, Scale
from hapticd.effects.catalogue import BROKEN, CATALOGUE, OWN_SLUGS
from hapticd.effects.pages import page, with_table
from hapticd.effects.spec import ACTS_ON

DOCS = Path(__file__).parents[2] / "docs" / "effects"
ROTARY = Scale(
    inertia=6.28e-6,
    viscous=9e-6,
    coulomb=2e-3,
    torque_constant=0.0292,
    resolution=2 * math.pi / 8192,
    period_s=1e-3,
    duration_s=20.0,
    torque=5e-3,
    speeds=(0.1, 1.0, 4.0, 20.0, 50.0),
    currents=(0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.0),
    positions=(-1.0, -0.5, 0.1, 0.5, 1.0),
    travel=2.4,
)
LINEAR = replace(ROTARY, resolution=1e-6, inertia=2.0, coulomb=5.0, torque=9.0, travel=0.2, is_linear=True)
AT_REST = replace(
    ROTARY, coulomb=0.0, torque=0.0, speeds=(0.0,) * 5, currents=(0.0,) * 7, positions=(0.0,) * 5, travel=0.0
)
COUNTED = {
    "inertia_error",
    "viscous_friction",
    "coulomb_friction",
    "torque_constant_error",
    "asymmetric_coulomb",
    "asymmetric_viscous",
    "constant_bias",
    "stribeck",
    "thermal_drift",
    "transport_delay",
    "amplifier_lag",
    "return_spring",
}
SWITCHES = {
    "transport_delay",
    "amplifier_lag",
    "current_saturation",
    "dac_quantization",
    "backlash",
    "flexible_coupling",
    "presliding",
    "dropped_samples",
    "hand_impedance",
}
FOUND_BY_OTHER_MEANS = {"torque_ripple", "hand_impedance"}


def test_every_slug_has_one_file_one_entry_and_one_page() -> None:
    assert tuple(CATALOGUE) == EFFECT_SLUGS == OWN_SLUGS
    assert len(EFFECT_SLUGS) == 24
    assert {page.stem for page in DOCS.glob("*.md")} == {*EFFECT_SLUGS, "README"}
    assert not BROKEN


@pytest.mark.parametrize("slug", EFFECT_SLUGS)
def test_an_entry_is_consistent(slug: str) -> None:
    effect = CATALOGUE[slug]
    assert effect.slug == slug
    for other in effect.equivalent_to:
        assert slug in CATALOGUE[other].equivalent_to
    for other in effect.excludes:
        assert slug in CATALOGUE[other].excludes
    for other in effect.contains:
        assert slug not in CATALOGUE[other].contains
    related = {*effect.near, *effect.equivalent_to, *effect.contains, *effect.excludes}
    assert related <= set(EFFECT_SLUGS) - {slug}
    assert effect.acts_on in ACTS_ON
    for parameter in effect.parameters:
        assert parameter.lower < parameter.upper < math.inf
        assert parameter.lower <= parameter.neutral
        assert parameter.lower >= 0.0 or parameter.scale == "linear"


def test_the_relations_that_others_build_on() -> None:
    assert {slug for slug, effect in CATALOGUE.items() if effect.in_loop is not None} == COUNTED
    assert {slug for slug, effect in CATALOGUE.items() if not effect.amplitude} == SWITCHES
    assert {slug for slug, effect in CATALOGUE.items() if effect.acts_on == "base"} == {
        "inertia_error",
        "viscous_friction",
        "coulomb_friction",
        "torque_constant_error",
    }
    assert not any(effect.is_hooked for effect in CATALOGUE.values())


@pytest.mark.parametrize("slug", EFFECT_SLUGS)
def test_an_amplitude_is_a_parameter_and_off_at_zero(slug: str) -> None:
    effect = CATALOGUE[slug]
    if effect.amplitude:
        (parameter,) = (parameter for parameter in effect.parameters if parameter.name == effect.amplitude)
        assert parameter.neutral == 0.0


@pytest.mark.parametrize("scale", [ROTARY, LINEAR, AT_REST], ids=["rotary", "linear", "at_rest"])
@pytest.mark.parametrize("slug", EFFECT_SLUGS)
def test_starts_are_entries_of_a_config(slug: str, scale: Scale) -> None:
    starts = CATALOGUE[slug].starts(scale)
    assert bool(starts) != (slug in FOUND_BY_OTHER_MEANS) or scale is AT_REST
    # An effect on the current is a known torque for each of its starts, which costs next to nothing; others cost a run each.
    many = CATALOGUE[slug].acts_on == "input"
    most = 400 if many else 60 if slug == "backlash" else 30  # a play has two forms of contact
    assert len(starts) <= most
    encoder = {"counts_per_metre": 1e6} if scale.is_linear else {"counts_per_rev": 8192}
    for values in starts[:: 20 if many else 1]:
        parse_config({"encoder": encoder, "plant": {"effects": [{"name": slug, **values}]}}, "start")


def test_starts_cover_the_plausible_range() -> None:
    omega_s = [values["omega_s"] for values in CATALOGUE["stribeck"].starts(ROTARY)]
    assert omega_s == pytest.approx([0.02 * 1000 ** (k / 5) for k in range(6)])
    counts = {round(values["breakaway"] / ROTARY.resolution) for values in CATALOGUE["presliding"].starts(ROTARY)}
    assert counts == {4, 12, 35, 105, 313}
    assert [values["t_d"] for values in CATALOGUE["transport_delay"].starts(ROTARY)] == [3e-4, 1e-3, 2e-3, 4e-3, 8e-3]
    assert len(CATALOGUE["flexible_coupling"].starts(ROTARY)) == 18


def test_starts_stay_within_bounds_and_differ() -> None:
    effect = replace(
        CATALOGUE["transport_delay"], grid=lambda scale: [{"t_d": -1.0}, {"t_d": 0.0}, {"t_d": math.inf}, {"t_d": 2.0}]
    )
    assert effect.starts(ROTARY) == ({"t_d": 0.0}, {"t_d": 1.0})


def test_parameters_are_completed_with_neutral_values() -> None:
    ripple = CATALOGUE["torque_ripple"].complete({"orders": [7.0, 14.0], "amplitudes": (1e-3, 2e-3)})
    assert ripple["orders"] == (7.0, 14.0, *[0.0] * 6)
    assert ripple["phases"] == (0.0,) * 8
    assert ripple["current_proportion"] == 0.0
    assert CATALOGUE["amplifier_lag"].complete({"f_a": 100.0}) == {"f_a": 100.0, "delta": 0.7}


@pytest.mark.parametrize("slug", EFFECT_SLUGS)
def test_a_page_is_what_is_made_of_the_entry(slug: str) -> None:
    text = (DOCS / f"{slug}.md").read_text()
    assert text == page(CATALOGUE[slug]), "make docs"
    example = text.split("```yaml\n")[1].split("```")[0]
    assert parse_config(yaml.safe_load(example), "page").plant.effects[0].name == slug


def test_a_page_holds_all_that_the_entry_says() -> None:
    effect: Effect = CATALOGUE["asymmetric_coulomb"]
    notes = effect.notes
    text = " ".join(page(effect).split())
    for part in (effect.summary, effect.law, effect.source, effect.where_it_shows, notes.told_apart):
        assert part in text
    for part in (notes.shown_by, notes.simulated, "| `a` | number | number | 0 | -1 … 1 |", "](constant_bias.md)"):
        assert part in text


def test_the_table_is_made_of_the_catalogue() -> None:
    readme = (DOCS / "README.md").read_text()
    assert readme == with_table(readme), "make docs"
    for slug in EFFECT_SLUGS:
        assert f"| [{slug}]({slug}.md) |" in readme


def test_no_file_of_config_or_theory_names_an_effect() -> None:
    """All that is particular to an effect is in its file; where laws meet the motion the plant knows them by name."""
    package = DOCS.parents[1] / "hapticd"
    for folder in ("config", "stability", "servo", "service", "cli", "record"):
        for file in (package / folder).rglob("*.py"):
            text = file.read_text()
            named = {slug for slug in EFFECT_SLUGS if f'"{slug}"' in text}
            assert not named, file
