"""The improved model is a config like any other, whatever the fit made of its parameters."""

from __future__ import annotations

from typing import Any

import pytest
import yaml

from hapticd.config import ConfigError, parse_config, parse_yaml
from hapticd.gap.model_file import changed_lines, improved_model, model_yaml, with_effects
from hapticd.gap.result import Estimate, GapNumbers, GapResult, Remainder, Step

MODEL = parse_config({"plant": {"effects": [{"name": "constant_bias", "tau_0": 1e-4}]}}, "model")


def found(*entries: tuple[str, dict[str, Any]], base: dict[str, float] | None = None) -> GapResult:
    steps = tuple(Step(slug, {}, 2e-4, 1e-4, 0.9, 8.0, 50.0, (), (), entry) for slug, entry in entries)
    return GapResult(
        "effect_found",
        "Missing.",
        tuple(slug for slug, _ in entries),
        steps,
        GapNumbers(2e-4, 1e-4, 2e-4, 1e-4, 1e-6, "N m"),
        Remainder(0.0, "Nothing is left.", ()),
        base={name: Estimate(value, (value, value), "") for name, value in (base or {}).items()},
    )


def test_effects_join_those_of_the_model_and_the_text_reads_as_the_model() -> None:
    result = found(
        ("gravity", {"m_g_l": 1e-3, "theta_0": 0.2}),
        ("torque_ripple", {"orders": [7.0, 14.0], "amplitudes": [1e-4, 5e-5], "phases": [0.1, 0.2]}),
        ("inertia_error", {"r": 0.5}),
    )
    improved = improved_model(MODEL, result)
    assert [effect.name for effect in improved.plant.effects] == ["constant_bias", "gravity", "torque_ripple"]
    assert improved.plant.inertia == pytest.approx(1.5 * MODEL.plant.inertia)
    text = model_yaml(MODEL, result, ["lab.csv"])
    assert parse_config(yaml.safe_load(text), "text") == improved
    assert "# gap: missing force 0.0002 N m before, 0.0001 N m after" in text
    assert text.count("gap: inertia_error") == 1  # not beside its uncertainty too


RIG = """# my rig
servo: {rate_hz: 500}   # the bus does no more
plant:
  # guessed from the drawing
  inertia: 1.0e-6 kg m²
  effects:
    - {name: constant_bias, tau_0: 1.0e-4}  # the cable
record: {directory: /srv/runs}
"""


def test_of_the_user_s_own_file_all_that_does_not_change_stays() -> None:
    model = parse_yaml(RIG, "rig.yaml")
    result = found(("inertia_error", {"r": 0.5}), ("gravity", {"m_g_l": 1e-3, "theta_0": 0.2}))
    text = model_yaml(model, result, ["lab.csv"], RIG)
    for kept in ("# my rig", "# the bus does no more", "# guessed from the drawing", "# the cable", "/srv/runs"):
        assert kept in text
    assert parse_yaml(text, "written").plant == improved_model(model, result).plant
    changed = [line for line in changed_lines(RIG, text).splitlines() if "# gap: " not in line[:8]]
    begin = ("-  inertia: 1.0e-6 kg m²", "+  inertia: 1.5", "+    # gap: gravity", "+    - {name: gravity")
    assert len(changed) == len(begin)
    assert all(line.startswith(text) for line, text in zip(changed, begin, strict=True))
    again = model_yaml(parse_yaml(text, "again"), found(("stribeck", {"s": 0.2, "omega_s": 1.0})), ["next.csv"], text)
    assert again.count("improved from") == 1


def test_a_model_of_a_run_has_no_place_of_the_host_that_recorded_it() -> None:
    assert "directory" not in model_yaml(parse_yaml(RIG, "rig.yaml"), found(), ["lab.csv"])


def test_the_uncertainty_of_what_is_replaced_goes() -> None:
    known = parse_config(
        MODEL.model_dump() | {"plant": MODEL.plant.model_dump() | {"uncertainty": {"inertia": 1e-8}}}, "m"
    )
    assert improved_model(known, found(("gravity", {"m_g_l": 1e-3, "theta_0": 0.2}))).plant.uncertainty.inertia == 1e-8
    other = found(("inertia_error", {"r": 0.5}))
    assert improved_model(known, other).plant.uncertainty == MODEL.plant.uncertainty


@pytest.mark.parametrize(
    ("slug", "entry", "name", "value"),
    [
        ("gravity", {"m_g_l": -1e-3, "theta_0": 0.2}, "m_g_l", 0.0),
        ("torque_ripple", {"orders": [7.0], "amplitudes": [1e-4], "phases": [50.0]}, "phases", (12.566370614359172,)),
        ("flexible_coupling", {"f_r": 20.0, "load_share": 1.4}, "load_share", 0.99),
    ],
)
def test_a_value_that_no_config_may_have_becomes_its_bound(
    slug: str, entry: dict[str, Any], name: str, value: Any
) -> None:
    effect = improved_model(MODEL, found((slug, entry))).plant.effects[-1]
    assert (effect.model_extra or {})[name] == value


def test_an_error_edits_its_key_and_no_other_base_parameter() -> None:
    improved = improved_model(MODEL, found(("torque_constant_error", {"r": 0.1}), base={"inertia": 1e-5}))
    assert improved.plant.inertia == MODEL.plant.inertia
    assert improved.amplifier.torque_constant == pytest.approx(1.1 * MODEL.amplifier.torque_constant)


def test_effects_that_no_device_has_together_are_refused() -> None:
    both = [("backlash", {"gap": 0.01}), ("flexible_coupling", {"f_r": 20.0})]
    with pytest.raises(ConfigError):
        with_effects(MODEL, both)
