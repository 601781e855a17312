"""Every effect, in the order of the device vector."""

from __future__ import annotations

from importlib import import_module

from hapticd.config.effect_parameters import EFFECT_SLUGS
from hapticd.plant.effects.spec import EffectSpec

CATALOGUE: dict[str, EffectSpec] = {
    slug: import_module(f"hapticd.plant.effects.{slug}").EFFECT for slug in EFFECT_SLUGS
}
"""Slug to what is known of the effect."""
