"""A second-order current loop behind the base model's delay."""

from __future__ import annotations

from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="amplifier_lag",
    summary=(
        "The amplifier's current loop has a bandwidth of its own, behind the base model's delay T_A, which stays."
    ),
    law="i'' = (2π f_a)² (u − i) − 2 delta (2π f_a) i', u the current of the base model",
    parameters=parameters_of("amplifier_lag"),
    source="A current loop of second order, which the base model takes as the delay T_A = 2 δ/ω (eq. 5).",
    where_it_shows=(
        "Residuals after every change of the command that fade, or ring, within a few 1/f_a; a first-order "
        "lag of time constant τ is delta large with delta / (π f_a) = τ."
    ),
    near=("transport_delay",),
    exact=True,
)
