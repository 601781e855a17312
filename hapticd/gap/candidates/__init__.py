"""Every effect of the catalogue as something that can be fitted: coordinates, bounds from the data, start values.

`BUILDERS[slug](context)` returns the starts from which an effect is fitted, an empty list where the recording cannot tell
anything about it (a limit that the command never reaches, friction errors of a device without friction).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hapticd.gap.candidates import angle, base, converter, drivetrain, dropped, electrical, forces, friction, grip

if TYPE_CHECKING:
    from collections.abc import Callable

    from hapticd.gap.context import Context
    from hapticd.gap.hypothesis import Term

BUILDERS: dict[str, Callable[[Context], list[Term]]] = {
    "inertia_error": base.inertia_error,
    "viscous_friction": base.viscous_friction,
    "coulomb_friction": base.coulomb_friction,
    "asymmetric_coulomb": friction.asymmetric_coulomb,
    "asymmetric_viscous": friction.asymmetric_viscous,
    "stribeck": friction.stribeck,
    "presliding": friction.presliding,
    "quadratic_drag": friction.quadratic_drag,
    "load_dependent_friction": friction.load_dependent_friction,
    "constant_bias": forces.constant_bias,
    "gravity": forces.gravity,
    "torque_ripple": angle.torque_ripple,
    "return_spring": forces.return_spring,
    "torque_constant_error": base.torque_constant_error,
    "transport_delay": electrical.transport_delay,
    "amplifier_lag": electrical.amplifier_lag,
    "current_saturation": electrical.current_saturation,
    "dac_quantization": converter.dac_quantization,
    "backlash": drivetrain.backlash,
    "flexible_coupling": drivetrain.flexible_coupling,
    "encoder_eccentricity": angle.encoder_eccentricity,
    "dropped_samples": dropped.dropped_samples,
    "thermal_drift": friction.thermal_drift,
    "hand_impedance": grip.hand_impedance,
}
"""Slug to builder, in the order of the documentation."""
