"""Play between motor and load: rigid contact at ±gap/2, inelastic or with a rebound."""

from __future__ import annotations

from hapticd.jit import njit
from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="backlash",
    summary="Play between the motor, which has encoder and friction, and the load.",
    law=(
        "inertia (1 − load_share) J on the motor, load_share J behind a play of total width gap; contact is "
        "rigid and keeps the momentum; the two part again at restitution times the speed at which they met, and "
        "at 0 move as one until the load would have to be pulled"
    ),
    parameters=parameters_of("backlash"),
    source="Nordin and Gutman 2002, the limit of a stiff contact; restitution: Newton 1687.",
    where_it_shows=(
        "After a reversal the shaft accelerates as if it were lighter, then a jump of the velocity at contact."
    ),
    near=("presliding", "flexible_coupling"),
)


@njit("float64(float64, float64, float64, float64)", inline=True)
def common_velocity(motor_inertia: float, omega: float, load_inertia: float, load_omega: float) -> float:
    """Return the velocity after an inelastic impact."""
    return (motor_inertia * omega + load_inertia * load_omega) / (motor_inertia + load_inertia)
