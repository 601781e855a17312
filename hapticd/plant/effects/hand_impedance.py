"""A grip that holds on for a while: inertia, damper and spring in parallel."""

from __future__ import annotations

from hapticd.jit import njit
from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="hand_impedance",
    summary="A hand holds the device for part of the record: inertia, damper and spring in parallel.",
    law=(
        "J → J + m_h, b → b + b_h, torque −k_h (θ − rest), for on_s ≤ t < off_s; the hand takes hold at the "
        "shaft's velocity"
    ),
    parameters=parameters_of("hand_impedance"),
    source="Sec. III-B of the paper; Kuchenbecker, Park and Niemeyer 2003.",
    where_it_shows="Residuals of inertia, damping and stiffness that begin and end at once.",
    near=("return_spring", "inertia_error", "viscous_friction"),
    exact=True,
)


@njit("boolean(float64, float64, float64)", inline=True)
def is_gripped(time: float, on_s: float, off_s: float) -> bool:
    """Whether the hand holds on at a time."""
    return on_s <= time < off_s


@njit("float64(float64, float64, float64, float64)", inline=True)
def until_switch(time: float, span: float, on_s: float, off_s: float) -> float:
    """Return the part of `span` after `time` that ends at the next taking hold or letting go."""
    if time < on_s < time + span:
        return on_s - time
    if time < off_s < time + span:
        return off_s - time
    return span
