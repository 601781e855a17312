"""What the theory can take of a plant's effects: errors of base parameters, delays, a spring; the weaker side of friction.

The criterion needs the least friction and the longest delay that the device ever has, so an effect that varies is counted
at its worst. What cannot be put into μ, β, σ, τ_D and κ is left to simulation, and `uncounted` names it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.stability.numbers import Loop

COUNTED: Final = frozenset(
    {
        "inertia_error",
        "viscous_friction",
        "coulomb_friction",
        "torque_constant_error",
        "asymmetric_coulomb",
        "asymmetric_viscous",
        "constant_bias",
        "stribeck",
        "thermal_drift",
        "transport_delay",
        "amplifier_lag",
        "return_spring",
    }
)
"""Effects that `with_effects` puts into the loop. A constant bias moves the place of rest and leaves the criterion alone;
the Stribeck friction is never less than the Coulomb friction, which counts."""


def with_effects(loop: Loop, config: Config) -> Loop:
    """The loop with what the theory can take of ``plant.effects``."""
    for effect in config.plant.effects:
        values: dict[str, Any] = effect.model_extra or {}
        r, a = float(values.get("r", 0.0)), abs(float(values.get("a", 0.0)))
        match effect.name:
            case "inertia_error":
                loop = replace(loop, inertia=loop.inertia * (1.0 + r))
            case "viscous_friction":
                loop = replace(loop, viscous=loop.viscous * (1.0 + r))
            case "coulomb_friction":
                loop = replace(loop, coulomb=loop.coulomb * (1.0 + r))
            case "torque_constant_error":
                loop = replace(loop, stiffness=loop.stiffness * (1.0 + r))
            case "asymmetric_coulomb":
                loop = replace(loop, coulomb=loop.coulomb * (1.0 - a))
            case "asymmetric_viscous":
                loop = replace(loop, viscous=loop.viscous * (1.0 - a))
            case "thermal_drift":
                loop = replace(loop, coulomb=loop.coulomb * min(1.0, 1.0 + r))
            case "transport_delay":
                loop = replace(loop, delay=loop.delay + float(values["t_d"]))
            case "amplifier_lag":
                # As the amplifier itself: T_A = 2 δ/ω (5).
                loop = replace(loop, delay=loop.delay + float(values.get("delta", 0.7)) / (math.pi * values["f_a"]))
            case "return_spring":
                loop = loop.with_hand(stiffness=float(values["k_s"]))
    return loop


def uncounted(config: Config) -> tuple[str, ...]:
    """Effects of the plant that the theory leaves out."""
    return tuple(effect.name for effect in config.plant.effects if effect.name not in COUNTED)
