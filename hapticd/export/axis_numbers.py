"""The numbers of a config's axis, as the exported models take them: corrections applied, parallel springs joined."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from drivers import declared_latency
from hapticd.effects import asymmetric_coulomb
from hapticd.effects.catalogue import CATALOGUE
from hapticd.effects.parameters import corrected
from hapticd.export.plain.numbers import Numbers

if TYPE_CHECKING:
    from hapticd.config import Config

PARTS_OF_A_PERIOD = 10
"""Into so many parts a servo period is divided at least."""
_PHASE = 0.1
"""Largest angle [rad] of a swing in a part."""
_DECAY = 0.1
"""Largest share of its time in which a damper takes the speed away."""
_SHORTEST_S = 2e-6


def axis_numbers(config: Config) -> Numbers:
    """An axis that does what the config's plant, amplifier, encoder and hand do, with the driver's declared latency.

    The amplifier is its current loop, as in ``hapticd simulate``; with ``amplifier_lag`` the delay (5), and that effect.
    Effects from outside the catalogue are left out.
    """
    effects = {
        effect.name: CATALOGUE[effect.name].complete(effect.model_extra or {}) for effect in config.plant.effects
    }

    def of(slug: str, name: str) -> Any:
        effect = CATALOGUE[slug]
        return effects.get(slug, effect.complete({}))[name]

    inertia = corrected(config.plant.inertia, of("inertia_error", "r"))
    coulomb = corrected(config.plant.coulomb, of("coulomb_friction", "r"))
    torque_constant = corrected(config.amplifier.torque_constant, of("torque_constant_error", "r"))
    stiffness, rest = _joined(
        config.hand.stiffness,
        config.origin_counts * config.raw_resolution,
        of("return_spring", "k_s"),
        of("return_spring", "theta_0"),
    )
    load = 0.0
    if of("backlash", "gap") > 0.0:
        load = of("backlash", "load_share") * inertia
    elif of("flexible_coupling", "f_r") < math.inf:
        load = of("flexible_coupling", "load_share") * inertia
    natural = 2.0 * math.pi * of("flexible_coupling", "f_r") if load and not of("backlash", "gap") else 0.0
    return _fine(
        config.period,
        Numbers(
            inertia=inertia + config.hand.inertia,
            torque_constant=torque_constant,
            viscous=corrected(config.plant.viscous, of("viscous_friction", "r")),
            viscous_asymmetry=of("asymmetric_viscous", "a"),
            damping=config.hand.damping,
            coulomb=coulomb,
            stribeck_share=of("stribeck", "s"),
            stribeck_speed=of("stribeck", "omega_s"),
            load_friction=of("load_dependent_friction", "kappa"),
            drag=of("quadratic_drag", "d"),
            warming=of("thermal_drift", "r"),
            warming_time_s=of("thermal_drift", "t_w"),
            breakaway=of("presliding", "breakaway"),
            bristle_damping=of("presliding", "sigma_1"),
            bias=of("constant_bias", "tau_0") + asymmetric_coulomb.torque(coulomb, of("asymmetric_coulomb", "a")),
            stiffness=stiffness,
            rest=rest,
            gravity=of("gravity", "m_g_l"),
            gravity_rest=of("gravity", "theta_0"),
            ripple=tuple(
                wave
                for wave in zip(
                    of("torque_ripple", "orders"),
                    of("torque_ripple", "amplitudes"),
                    of("torque_ripple", "phases"),
                    strict=True,
                )
                if wave[1] != 0.0
            ),
            ripple_proportion=of("torque_ripple", "current_proportion"),
            hand_inertia=of("hand_impedance", "m_h"),
            hand_damping=of("hand_impedance", "b_h"),
            hand_stiffness=of("hand_impedance", "k_h"),
            hand_rest=of("hand_impedance", "rest"),
            hand_on_s=of("hand_impedance", "on_s"),
            hand_off_s=of("hand_impedance", "off_s"),
            load_inertia=load,
            play=of("backlash", "gap"),
            restitution=of("backlash", "restitution"),
            coupling_stiffness=load * natural * natural,
            coupling_damping=2.0 * of("flexible_coupling", "damping") * load * natural,
            lost=of("dropped_samples", "p"),
            eccentricity=of("encoder_eccentricity", "e"),
            eccentricity_phase=of("encoder_eccentricity", "phi"),
            resolution=config.raw_resolution,
            counts_backwards=config.encoder.invert,
            **_electrical(config, of),
        ),
    )


def _electrical(config: Config, of: Any) -> dict[str, Any]:
    amplifier = config.amplifier
    latency_s, _ = declared_latency(config)
    delay = latency_s + of("transport_delay", "t_d")
    lag, ratio = of("amplifier_lag", "f_a"), of("amplifier_lag", "delta")
    if lag < math.inf:
        delay += amplifier.delay
    elif amplifier.bandwidth_hz:
        lag, ratio = amplifier.bandwidth_hz, amplifier.damping_ratio
    ideal = not (amplifier.dac_bits and amplifier.dac_full_scale)
    return {
        "delay_s": delay,
        "lag_hz": lag,
        "lag_ratio": ratio,
        "dac_step": 0.0 if ideal else math.ldexp(amplifier.dac_full_scale or 0.0, 1 - (amplifier.dac_bits or 0)),
        "dac_codes": 0 if ideal else (1 << ((amplifier.dac_bits or 0) - 1)) - 1,
        "command_step": of("dac_quantization", "q"),
        "current_limit": min(amplifier.peak_current or math.inf, of("current_saturation", "i_max")),
    }


def _joined(k_1: float, rest_1: float, k_2: float, rest_2: float) -> tuple[float, float]:
    """Stiffness and rest position of two springs in parallel."""
    stiffness = k_1 + k_2
    return stiffness, (k_1 * rest_1 + k_2 * rest_2) / stiffness if stiffness > 0.0 else 0.0


def _fine(period_s: float, n: Numbers) -> Numbers:
    """The same in parts short enough for what swings and decays in it."""
    moving = n.inertia - n.load_inertia
    stiffness = n.stiffness + n.hand_stiffness + abs(n.gravity)
    stiffness += sum(order * height for order, height, _ in n.ripple) * max(1.0, n.ripple_proportion)
    if n.load_inertia and n.coupling_stiffness:
        stiffness += n.coupling_stiffness * n.inertia / n.load_inertia
    damping = n.damping + n.hand_damping + n.coupling_damping
    parts = [PARTS_OF_A_PERIOD / period_s, math.sqrt(stiffness / moving) / _PHASE, damping / moving / _DECAY]
    return replace(n, longest_part_s=max(1.0 / max(parts), _SHORTEST_S))
