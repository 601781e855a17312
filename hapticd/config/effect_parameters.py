"""Parameters of the effects that a plant model may list: name, unit, neutral value, bounds.

They are config keys (``plant.effects[k].<name>``) like any other, so they live here, without compiled code; the laws are in
`hapticd.plant.effects`, one file an effect. Angles, torques and inertias of a rotary device become lengths, forces and
masses of a linear one; where the unit changes, both are given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes:
        name: key in YAML and in ``gap.json``.
        unit: for a rotary device; "" for a pure number.
        unit_linear: for a linear device.
        neutral: value while the effect is off, and where a config leaves an optional parameter out.
        lower: smallest value that a config may give.
        upper: largest value that a config may give.
        scale: "log" for a positive magnitude that a search should vary by factors, "linear" otherwise.
        required: whether a config must give it.
        length: 1 for a number; otherwise the largest length of a list.
    """

    name: str
    unit: str
    unit_linear: str
    neutral: float
    lower: float
    upper: float
    scale: Literal["linear", "log"] = "linear"
    required: bool = False
    length: int = 1


RIPPLE_ORDERS = 8
"""Orders that ``torque_ripple`` may hold."""

_TORQUE = ("N m", "N")
_ANGLE = ("rad", "m")
_DAMPING = ("N m s/rad", "N s/m")
_STIFFNESS = ("N m/rad", "N/m")
_NUMBER = ("", "")


def _relative(name: str, lower: float, upper: float) -> Parameter:
    return Parameter(name, *_NUMBER, neutral=0.0, lower=lower, upper=upper, required=True)


def _shift(name: str, units: tuple[str, str] = _ANGLE, limit: float = 1e6) -> Parameter:
    return Parameter(name, *units, neutral=0.0, lower=-limit, upper=limit)


def _phase(name: str = "phi", length: int = 1) -> Parameter:
    return Parameter(name, "rad", "rad", neutral=0.0, lower=-4 * math.pi, upper=4 * math.pi, length=length)


def _magnitude(name: str, units: tuple[str, str], upper: float, *, required: bool = True) -> Parameter:
    return Parameter(name, *units, neutral=0.0, lower=0.0, upper=upper, scale="log", required=required)


_LOAD_SHARE = Parameter("load_share", *_NUMBER, neutral=0.5, lower=0.01, upper=0.99)

EFFECT_PARAMETERS: dict[str, tuple[Parameter, ...]] = {
    "inertia_error": (_relative("r", -0.8, 4.0),),
    "viscous_friction": (_relative("r", -1.0, 20.0),),
    "coulomb_friction": (_relative("r", -1.0, 5.0),),
    "asymmetric_coulomb": (_relative("a", -1.0, 1.0),),
    "asymmetric_viscous": (_relative("a", -1.0, 1.0),),
    "stribeck": (
        _relative("s", 0.0, 10.0),
        Parameter("omega_s", "rad/s", "m/s", neutral=1.0, lower=1e-6, upper=1e4, scale="log", required=True),
    ),
    "presliding": (
        _magnitude("breakaway", _ANGLE, 10.0),
        _magnitude("sigma_1", _DAMPING, 1e4, required=False),
    ),
    "quadratic_drag": (Parameter("d", "N m s²/rad²", "N s²/m²", neutral=0.0, lower=-1e4, upper=1e4, required=True),),
    "load_dependent_friction": (_relative("kappa", 0.0, 1.0),),
    "constant_bias": (Parameter("tau_0", *_TORQUE, neutral=0.0, lower=-1e4, upper=1e4, required=True),),
    "gravity": (_magnitude("m_g_l", _TORQUE, 1e4), _shift("theta_0")),
    "torque_ripple": (
        Parameter(
            "orders",
            "1/rev",
            "rad/m",
            neutral=0.0,
            lower=0.0,
            upper=1e5,
            scale="log",
            required=True,
            length=RIPPLE_ORDERS,
        ),
        Parameter(
            "amplitudes", *_TORQUE, neutral=0.0, lower=0.0, upper=1e4, scale="log", required=True, length=RIPPLE_ORDERS
        ),
        _phase("phases", RIPPLE_ORDERS),
        Parameter("current_proportion", *_NUMBER, neutral=0.0, lower=0.0, upper=1.0),
    ),
    "return_spring": (_magnitude("k_s", _STIFFNESS, 1e6), _shift("theta_0")),
    "torque_constant_error": (_relative("r", -0.8, 4.0),),
    "transport_delay": (_magnitude("t_d", ("s", "s"), 1.0),),
    "amplifier_lag": (
        Parameter("f_a", "Hz", "Hz", neutral=math.inf, lower=1.0, upper=1e6, scale="log", required=True),
        Parameter("delta", *_NUMBER, neutral=0.7, lower=0.01, upper=10.0, scale="log"),
    ),
    "current_saturation": (
        Parameter("i_max", "A", "A", neutral=math.inf, lower=1e-9, upper=1e6, scale="log", required=True),
    ),
    "dac_quantization": (_magnitude("q", ("A", "A"), 1e4),),
    "backlash": (
        _magnitude("gap", _ANGLE, 10.0),
        _LOAD_SHARE,
        Parameter("restitution", *_NUMBER, neutral=0.0, lower=0.0, upper=0.95),
    ),
    "flexible_coupling": (
        Parameter("f_r", "Hz", "Hz", neutral=math.inf, lower=0.1, upper=1e4, scale="log", required=True),
        _LOAD_SHARE,
        Parameter("damping", *_NUMBER, neutral=0.02, lower=0.0, upper=2.0),
    ),
    "encoder_eccentricity": (_magnitude("e", _ANGLE, 0.9), _phase()),
    "dropped_samples": (Parameter("p", *_NUMBER, neutral=0.0, lower=0.0, upper=0.99, required=True),),
    "thermal_drift": (
        _relative("r", -1.0, 10.0),
        Parameter("t_w", "s", "s", neutral=1.0, lower=1e-3, upper=1e6, scale="log", required=True),
    ),
    "hand_impedance": (
        _magnitude("m_h", ("kg m²", "kg"), 1e3, required=False),
        _magnitude("b_h", _DAMPING, 1e4, required=False),
        _magnitude("k_h", _STIFFNESS, 1e6, required=False),
        Parameter("on_s", "s", "s", neutral=0.0, lower=0.0, upper=1e9),
        Parameter("off_s", "s", "s", neutral=1e9, lower=0.0, upper=1e9),
        _shift("rest"),
    ),
}
"""Slug to parameters of every effect, in the order of the documentation."""

EFFECT_SLUGS: tuple[str, ...] = tuple(EFFECT_PARAMETERS)
