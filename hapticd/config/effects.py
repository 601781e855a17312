"""Names of the effects that a plant model may list, and their check.

The catalogue of effects registers here what this version can compute; a slug that is known but not registered is
refused clearly rather than ignored.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from pydantic import BaseModel, ConfigDict, Field

from hapticd.config.nearest import nearest_name
from hapticd.config.problems import NO_VALUE, Finding

EFFECT_SLUGS: tuple[str, ...] = (
    "inertia_error",
    "viscous_friction",
    "coulomb_friction",
    "asymmetric_coulomb",
    "asymmetric_viscous",
    "stribeck",
    "presliding",
    "quadratic_drag",
    "load_dependent_friction",
    "constant_bias",
    "gravity",
    "torque_ripple",
    "return_spring",
    "torque_constant_error",
    "transport_delay",
    "amplifier_lag",
    "current_saturation",
    "dac_quantization",
    "backlash",
    "flexible_coupling",
    "encoder_eccentricity",
    "dropped_samples",
    "thermal_drift",
    "hand_impedance",
)

SUPPORTED_EFFECTS: dict[str, tuple[str, ...]] = {}
"""Slug to parameter names of the effects that this version can compute."""


class Effect(BaseModel):
    """One effect of a plant model: its slug and its parameters, as extra fields."""

    model_config = ConfigDict(frozen=True, extra="allow")

    name: str = Field(description="Slug of the effect", json_schema_extra={"enum": list(EFFECT_SLUGS)})


def effect_findings(effects: object) -> Iterator[Finding]:
    """What is wrong with the value of ``plant.effects``; keys are relative to it (``[0].name``)."""
    if not isinstance(effects, list | tuple):
        yield Finding("", effects, "must be a list of effects, such as [{name: stribeck}]")
        return
    for index, effect in enumerate(effects):
        if isinstance(effect, Effect):
            effect = effect.model_dump()
        if isinstance(effect, Mapping) and isinstance(effect.get("name"), str):
            yield from _effect_findings(f"[{index}]", effect)
        else:
            yield Finding(f"[{index}]", effect, "must be a mapping with the effect's name, such as {name: stribeck}")


def _effect_findings(key: str, effect: Mapping[str, object]) -> Iterator[Finding]:
    slug = str(effect["name"])
    if slug not in EFFECT_SLUGS:
        close = nearest_name(slug, EFFECT_SLUGS)
        hint = f"did you mean {close}?" if close else "known effects: " + ", ".join(EFFECT_SLUGS)
        yield Finding(f"{key}.name", slug, f"unknown effect; {hint}", EFFECT_SLUGS, close)
        return
    if slug not in SUPPORTED_EFFECTS:
        yield Finding(f"{key}.name", slug, "known effect, not available in this version")
        return
    parameters = SUPPORTED_EFFECTS[slug]
    for name in effect:
        if name != "name" and name not in parameters:
            close = nearest_name(str(name), parameters)
            hint = f"did you mean {close}?" if close else "valid: " + ", ".join(parameters)
            yield Finding(f"{key}.{name}", NO_VALUE, f"unknown parameter of {slug}; {hint}", parameters, close)
