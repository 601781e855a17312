"""Friction that grows with the load: c → c + κ|K_t i|."""

from __future__ import annotations

from hapticd.effects.parameters import relative
from hapticd.effects.spec import Effect, Notes


def friction(kappa: float, torque: float) -> float:
    """Return the Coulomb friction that the motor's torque adds."""
    return kappa * abs(torque)


EFFECT = Effect(
    slug="load_dependent_friction",
    summary="Friction grows with the torque that a bearing or gear carries.",
    law="c → c + kappa |K_t i|",
    parameters=(relative("kappa", 0.0, 1.0),),
    acts_on="friction",
    source="Bearing friction proportional to load (SKF, Harris 2001); gear meshes likewise.",
    where_it_shows=(
        "In motion under a large current friction is larger by kappa |K_t i|; coasting at the same speed shows none of "
        "it."
    ),
    example="kappa: 0.1",
    notes=Notes(
        told_apart=(
            "Driving in one direction, −kappa K_t i looks like a `torque_constant_error` of −kappa; braking, it has the "
            "other sign."
        ),
        shown_by="driving and braking at the same speed, with large currents.",
        simulated="Closed form.",
    ),
    amplitude="kappa",
    grid=lambda scale: [{"kappa": 0.05}],
    near=("torque_constant_error", "coulomb_friction"),
)
