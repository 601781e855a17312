"""Motor and load joined by a spring and a damper."""

from __future__ import annotations

from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="flexible_coupling",
    summary="A flexible coupling or belt between the motor, which has encoder and friction, and the load.",
    law=(
        "inertia (1 − load_share) J on the motor, J_L = load_share J behind it; torque k (θ_L − θ) + d (ω_L −"
        " ω), k = J_L (2π f_r)², d = 2 damping J_L 2π f_r"
    ),
    parameters=parameters_of("flexible_coupling"),
    source="Two-mass drive: Ellis and Lorenz 2000; f_r is the anti-resonance seen from the motor.",
    where_it_shows="Ringing after every step at f_r / √(1 − load_share); the motor does not move at f_r.",
    near=("amplifier_lag", "backlash"),
)
