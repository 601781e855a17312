"""From the parameters of hidden effects to the device that is simulated: the laws' symbols, one function an effect.

Every function takes the device as it is so far and one effect's parameters, and returns the changed device. A linear
device uses the same names in m and N.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.gap.physics import Device

Effect = dict[str, Any]
"""An effect's ``name`` (slug) and its parameters."""

_CONTACT_HZ = 1500.0
_CONTACT_DAMPING = 0.3


def _base(field: str) -> Callable[..., Device]:
    return lambda d, r: d._replace(**{field: getattr(d, field) * (1.0 + r)})


def _presliding(d: Device, breakaway: float, sigma_1: float) -> Device:
    if breakaway == 0.0:
        return d
    stiffness = d.coulomb / breakaway
    return d._replace(bristle_breakaway=breakaway, bristle_stiffness=stiffness, bristle_damping=sigma_1)


def _ripple(d: Device, orders: Sequence[float], amplitudes: Sequence[float], phases: Sequence[float]) -> Device:
    return d._replace(ripple=np.vstack([d.ripple, np.column_stack([orders, amplitudes, phases])]))


def _lag(d: Device, f_a: float, delta: float) -> Device:
    return d._replace(lag_omega=2.0 * math.pi * f_a if math.isfinite(f_a) else 0.0, lag_damping=delta)


def _one_joint(d: Device) -> None:
    if d.load_share > 0.0:
        raise ValueError("backlash and flexible_coupling: this simulation has one joint between motor and load")


def _backlash(
    d: Device, gap: float, load_share: float, stiffness: float = math.inf, damping: float | None = None
) -> Device:
    """As good as rigid, with a rebound, unless the contact has a stiffness."""
    if gap == 0.0:
        return d
    _one_joint(d)
    reduced = d.inertia * load_share * (1.0 - load_share)
    stiffness = min(stiffness, reduced * (2.0 * math.pi * _CONTACT_HZ) ** 2)
    if damping is None:
        damping = 2.0 * _CONTACT_DAMPING * math.sqrt(stiffness * reduced)
    return d._replace(backlash_half=gap / 2.0, load_share=load_share, joint_stiffness=stiffness, joint_damping=damping)


def _coupling(d: Device, f_r: float, load_share: float, damping: float) -> Device:
    if not math.isfinite(f_r):
        return d
    _one_joint(d)
    load, omega = d.inertia * load_share, 2.0 * math.pi * f_r
    return d._replace(load_share=load_share, joint_stiffness=load * omega**2, joint_damping=2 * damping * load * omega)


def _eccentricity(d: Device, e: float, phi: float, e_2: float = 0.0, phi_2: float = 0.0) -> Device:
    return d._replace(eccentricity=e, eccentricity_phase=phi, eccentricity_2=e_2, eccentricity_2_phase=phi_2)


def _hand(d: Device, m_h: float, b_h: float, k_h: float, on_s: float, off_s: float, rest: float) -> Device:
    return d._replace(
        hand_inertia=m_h,
        hand_damping=b_h,
        hand_stiffness=k_h,
        hand_theta=rest,
        hand_on_s=on_s,
        hand_off_s=off_s,
    )


LAWS: dict[str, Callable[..., Device]] = {
    "inertia_error": _base("inertia"),
    "viscous_friction": _base("viscous"),
    "coulomb_friction": _base("coulomb"),
    "torque_constant_error": _base("torque_constant"),
    "asymmetric_coulomb": lambda d, a: d._replace(coulomb_offset=d.coulomb_offset + a * d.coulomb),
    "asymmetric_viscous": lambda d, a: d._replace(viscous_asymmetry=a),
    "stribeck": lambda d, s, omega_s: d._replace(stribeck_s=s, stribeck_omega=omega_s),
    "presliding": _presliding,
    "quadratic_drag": lambda d, d_: d._replace(quadratic_drag=d_),
    "load_dependent_friction": lambda d, kappa: d._replace(load_friction=kappa),
    "constant_bias": lambda d, tau_0: d._replace(bias=d.bias + tau_0),
    "gravity": lambda d, m_g_l, theta_0: d._replace(gravity=m_g_l, gravity_theta=theta_0),
    "torque_ripple": _ripple,
    "return_spring": lambda d, k_s, theta_0: d._replace(spring=k_s, spring_theta=theta_0),
    "transport_delay": lambda d, t_d: d._replace(delay_s=d.delay_s + t_d),
    "amplifier_lag": _lag,
    "current_saturation": lambda d, i_max: d._replace(current_limit=i_max),
    "dac_quantization": lambda d, q: d._replace(dac_step=q),
    "backlash": _backlash,
    "flexible_coupling": _coupling,
    "encoder_eccentricity": _eccentricity,
    "dropped_samples": lambda d, p: d,
    "thermal_drift": lambda d, r, t_w: d._replace(drift=r, drift_time_s=t_w),
    "hand_impedance": _hand,
}
"""Slug to law. ``dropped_samples`` is no property of the device: the session loses the commands."""

_BASE_FIRST = ("inertia_error", "viscous_friction", "coulomb_friction", "torque_constant_error")
_KEYWORDS = {"d": "d_"}


def hide(device: Device, effects: Sequence[Effect]) -> Device:
    """The device with the effects; corrections of base values first, so that the other laws see the corrected ones.

    Raises:
        KeyError: a slug that is not in `LAWS`.
        ValueError: two effects that need a joint each.
    """
    for effect in sorted(effects, key=lambda effect: effect["name"] not in _BASE_FIRST):
        parameters = {_KEYWORDS.get(key, key): value for key, value in effect.items() if key != "name"}
        device = LAWS[effect["name"]](device, **parameters)
    return device


def loss_probability(effects: Sequence[Effect]) -> float:
    """Probability that the command of a tick is lost."""
    return next((effect["p"] for effect in effects if effect["name"] == "dropped_samples"), 0.0)
