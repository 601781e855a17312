"""The improved model: the given one with the effects that were found, and where each value came from as a comment."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from hapticd.config import Config, config_to_yaml, parse_config
from hapticd.config.text import yaml_value

if TYPE_CHECKING:
    from hapticd.gap.result import Estimate, GapResult, Step

BASE_KEYS: Final = {
    "inertia_error": ("plant", "inertia"),
    "viscous_friction": ("plant", "viscous"),
    "coulomb_friction": ("plant", "coulomb"),
    "torque_constant_error": ("amplifier", "torque_constant"),
}
"""Effects that are corrections of a key of the model."""


def improved_model(model: Config, result: GapResult) -> Config:
    """The model with everything that was found.

    A correction of a base parameter edits its key; every other effect joins ``plant.effects``, in place of an entry of
    the same name.
    """
    data = model.model_dump()
    for step in result.steps:
        add_effect(data, step.effect, step.entry)
    for name, estimate in result.base.items():
        section = "amplifier" if name == "torque_constant" else "plant"
        data[section][name] = estimate.value
    return parse_config(data, "the improved model")


def add_effect(data: dict[str, Any], slug: str, entry: Mapping[str, Any]) -> None:
    """Add an effect to a config as plain data.

    Args:
        data: `Config.model_dump`; changed in place.
        slug: the effect.
        entry: its parameters.
    """
    if slug in BASE_KEYS:
        section, key = BASE_KEYS[slug]
        data[section][key] *= 1.0 + entry["r"]
        return
    effects = [effect for effect in data["plant"]["effects"] if effect["name"] != slug]
    data["plant"]["effects"] = [*effects, {"name": slug, **_plain(entry)}]


def _plain(entry: Mapping[str, object]) -> dict[str, Any]:
    return {name: list(value) if isinstance(value, tuple) else value for name, value in entry.items()}


def model_yaml(model: Config, result: GapResult, recordings: Sequence[str]) -> str:
    """The improved model as YAML, with comments; reading it gives `improved_model`.

    Args:
        model: as given. result: what was found. recordings: files that it was found in.
    """
    improved = improved_model(model, result)
    lines = [
        f"# Improved by hapticd gap from {', '.join(recordings)}.",
        f"# {result.verdict}: {result.statement}",
        f"# Held-out gap {result.gap.held_out_before:.3g} before, {result.gap.held_out_after:.3g} after; 1 is as good as "
        "the data allow.",
    ]
    remarks = {BASE_KEYS[step.effect]: _remark(step) for step in result.steps if step.effect in BASE_KEYS}
    for name, estimate in result.base.items():
        remarks["amplifier" if name == "torque_constant" else "plant", name] = f"refitted, {_interval(estimate)}"
    section = ""
    for line in config_to_yaml(improved).splitlines():
        if found := re.match(r"(\w+):", line):
            section = found[1]
        key = line.strip().partition(":")[0]
        if section == "plant" and key == "effects" and improved.plant.effects:
            lines += ["  effects:", *_effect_lines(improved, result)]
        elif (section, key) in remarks and line.startswith("  "):
            lines.append(f"{line}{';' if '#' in line else '  #'} gap: {remarks[section, key]}")
        else:
            lines.append(line)
    return "\n".join(lines) + "\n"


def _effect_lines(improved: Config, result: GapResult) -> list[str]:
    found = {step.effect: step for step in result.steps}
    lines = []
    for effect in improved.plant.effects:
        if step := found.get(effect.name):
            lines.append(f"    # gap: {_remark(step)}")
        lines.append(f"    - {yaml_value(effect.model_dump())}")
    return lines


def _remark(step: Step) -> str:
    values = ", ".join(f"{name} {_interval(estimate)}" for name, estimate in step.parameters.items())
    other = (
        f"; these data do not tell it from {', '.join(step.indistinguishable_from)}"
        if step.indistinguishable_from
        else ""
    )
    return f"{step.effect}, {values}; held-out gap {step.gap_before:.3g} to {step.gap_after:.3g}{other}"


def _interval(estimate: Estimate) -> str:
    low, high = estimate.ci95
    unit = f" {estimate.unit}" if estimate.unit else ""
    return f"{estimate.value:.4g}{unit} (95 %: {low:.4g} to {high:.4g})"
