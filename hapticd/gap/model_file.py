"""The improved model: the given one with the found effects, and the origin of each value as a comment."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from hapticd.config import Config, parse_config, parse_yaml
from hapticd.config.editing import ConfigText, text_of
from hapticd.effects.catalogue import CATALOGUE

if TYPE_CHECKING:
    from hapticd.gap.result import Estimate, GapResult, Step

BASE_KEYS: Final = {
    "inertia_error": ("plant", "inertia"),
    "viscous_friction": ("plant", "viscous"),
    "coulomb_friction": ("plant", "coulomb"),
    "torque_constant_error": ("amplifier", "torque_constant"),
}
"""Effects that correct a key of the model."""
_HEAD: Final = "# gap: "
_OWN_HEAD: Final = re.compile(rf"^{_HEAD}.*\n", re.MULTILINE)
"""The header that an earlier run of gap wrote."""
_PLACES: Final = ("record", "api")
"""Sections with paths of the host: a recording does not change them."""


def improved_model(model: Config, result: GapResult) -> Config:
    """The model with all found effects.

    A correction of a base parameter changes its key. Any other effect is added to ``plant.effects``, and replaces an entry
    of the same name.
    """
    entries = [(step.effect, step.entry) for step in result.steps]
    corrected = {BASE_KEYS[slug][1] for slug, _ in entries if slug in BASE_KEYS}
    base = {name: value for name, value in result.assumed_friction.items() if name in corrected}
    return with_effects(model, entries, base)


def with_effects(
    model: Config, entries: Sequence[tuple[str, Mapping[str, Any]]], base: Mapping[str, float] = MappingProxyType({})
) -> Config:
    """A model with more effects and other base parameters.

    Args:
        model: is not modified.
        entries: slug and parameters, in the order in which they are added.
        base: key of ``plant`` to value. If one of these, or the delay, changes, ``plant.uncertainty`` is removed, because
            the uncertainties are correlated.

    Raises:
        ConfigError: the effects cannot be on one device.
    """
    data = model.model_dump()
    if base or {*BASE_KEYS, "transport_delay", "amplifier_lag"} & {slug for slug, _ in entries}:
        data["plant"]["uncertainty"] = {}  # it belongs to the old values
    data["plant"].update(base)  # first, because corrections are relative to it
    for slug, entry in entries:
        if slug in BASE_KEYS:
            section, key = BASE_KEYS[slug]
            data[section][key] *= 1.0 + entry["r"]
        else:
            effects = [effect for effect in data["plant"]["effects"] if effect["name"] != slug]
            data["plant"]["effects"] = [*effects, {"name": slug, **_admitted(slug, entry)}]
    return parse_config(data, "the improved model")


def _admitted(slug: str, entry: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of an effect, limited to the range that a config may have."""
    found: dict[str, Any] = {}
    for parameter in CATALOGUE[slug].parameters:
        if parameter.name in entry:
            value = entry[parameter.name]
            listed = isinstance(value, list | tuple)
            found[parameter.name] = [parameter.clamped(v) for v in value] if listed else parameter.clamped(value)
    return found


def model_yaml(model: Config, result: GapResult, recordings: Sequence[str], text: str | None = None) -> str:
    """The improved model as YAML with comments; it reads back as `improved_model`.

    Args:
        model: the given model. result: of the workflow. recordings: files that were fitted.
        text: YAML of the given model, which is edited in place; by default a YAML with all keys.
    """
    improved, gap = improved_model(model, result), result.gap
    lines = [
        f"improved from {', '.join(recordings)}.",
        f"{result.verdict}: {result.statement}",
        f"missing force {gap.held_out_before:.3g} {gap.unit} before, {gap.held_out_after:.3g} {gap.unit} after (RMS on "
        f"held-out data); noise floor {gap.noise_floor:.2g} {gap.unit}.",
    ]
    text = _OWN_HEAD.sub("", text_of(None, model) if text is None else text)
    written, before, after = ConfigText(text), parse_yaml(text, "the model").model_dump(), improved.model_dump()
    remarks = {BASE_KEYS[step.effect]: _remark(step, gap.unit) for step in result.steps if step.effect in BASE_KEYS}
    for section, values in after.items():
        if section in _PLACES:
            continue
        for key, value in values.items():
            if (section, key) != ("plant", "effects") and value != before[section][key]:
                remark = remarks.get((section, key))
                written.put(section, key, value, f"gap: {remark}" if remark else "")
    _put_effects(written, improved, before["plant"]["effects"], result)
    head = "".join(f"{_HEAD}{line}\n" for line in lines)
    return head + written.text("the improved model")


def changed_lines(before: str, after: str) -> str:
    """The changed lines of a text, as a diff without context."""
    lines = difflib.unified_diff(before.splitlines(), after.splitlines(), n=0, lineterm="")
    return "\n".join(line for line in lines if not line.startswith(("---", "+++", "@@")))


def _put_effects(written: ConfigText, improved: Config, before: Sequence[Mapping[str, Any]], result: GapResult) -> None:
    found = {step.effect: step for step in result.steps}
    wanted = [effect.model_dump(mode="json") for effect in improved.plant.effects]
    if wanted == before:
        return
    listed = written.effects()
    names = [entry["name"] for entry in wanted]
    for index in reversed(range(len(listed))):
        if listed[index]["name"] in found or listed[index]["name"] not in names:
            del listed[index]
    kept = {entry["name"] for entry in listed}
    for entry in wanted:
        if entry["name"] not in kept:
            listed.append(written.entry(entry))
            if step := found.get(entry["name"]):
                remark = f"gap: {_remark(step, result.gap.unit)}"
                listed.yaml_set_comment_before_after_key(len(listed) - 1, before=remark, indent=4)


def _remark(step: Step, unit: str) -> str:
    values = ", ".join(f"{name} {_interval(estimate)}" for name, estimate in step.parameters.items())
    other = (
        f"; these data do not distinguish it from {', '.join(step.indistinguishable_from)}"
        if step.indistinguishable_from
        else ""
    )
    return f"{step.effect}, {values}; missing force {step.gap_before:.3g} to {step.gap_after:.3g} {unit}{other}"


def _interval(estimate: Estimate) -> str:
    low, high = estimate.ci95
    unit = f" {estimate.unit}" if estimate.unit else ""
    return f"{estimate.value:.4g}{unit} (95 %: {low:.4g} to {high:.4g})"
