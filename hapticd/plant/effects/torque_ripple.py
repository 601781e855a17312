"""Cogging and torque ripple: Σ a_k sin(kθ + φ_k)."""

from __future__ import annotations

from hapticd.jit import njit
from hapticd.plant.effects.path_mean import mean_sine
from hapticd.plant.effects.spec import EffectSpec, parameters_of

EFFECT = EffectSpec(
    slug="torque_ripple",
    summary=(
        "Torque that depends on the angle, several orders a revolution; without current (cogging) or "
        "proportional to it."
    ),
    law=("+ Σ amplitudes_k sin(orders_k θ + phases_k) · (1 − current_proportion + current_proportion · i / 1 A)"),
    parameters=parameters_of("torque_ripple"),
    source="Cogging and commutation ripple: Jahns and Soong 1996.",
    where_it_shows="A residual torque periodic in position; its order shows in a periodogram over the angle.",
    near=("gravity", "encoder_eccentricity"),
)


@njit("float64(float64, float64)", inline=True)
def ripple_gain(current: float, proportion: float) -> float:
    """Return the common factor of all orders."""
    return 1.0 - proportion + proportion * current


@njit("float64(float64, float64, float64, float64, float64)", inline=True)
def ripple_torque(angle: float, half_way: float, order: float, amplitude: float, phase: float) -> float:
    """Return the torque of one order averaged over the angles `angle` ± `half_way`."""
    return amplitude * mean_sine(order * angle + phase, order * half_way)
