"""How an effect is drawn: its shape by chance, its size by a strength from 0.1 to 1.

At strength 1 an effect is plainly there and physically ordinary, in terms of the device and of what its session plays:
half the inertia wrong, a bias of three tenths of the friction, a play of a few tens of counts. A strength s scales that;
where a neutral value is infinite (a bandwidth, a limit), s = 1 is the lowest. Nothing that a workflow finds or fails to
find has a part in it: a degressive drag that hardly shows is hidden as it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from benchmarks.gap import devices
from benchmarks.gap.generate import STEP_S, Lab, Recording, generate
from benchmarks.gap.hidden import Effect

WEAKEST = 0.1
"""The least strength."""

ROTARY_ONLY = ("gravity", "torque_ripple", "encoder_eccentricity")

Shape = Callable[[float], dict[str, object]]
Recipe = Callable[[float], Effect]
"""Strength to effect."""


class Scale(NamedTuple):
    """What sizes are relative to: the device's nominal model, and its session with nothing hidden."""

    inertia: float
    viscous: float
    coulomb: float
    breakaway: float
    """Current that overcomes friction, A."""
    stiffness: float
    """Of the virtual spring in the session."""
    resolution: float
    period_s: float
    duration_s: float
    speed: float
    """Not exceeded nine tenths of the session."""
    top_speed: float
    travel: float
    """From the middle of the session's range to its ends."""
    limits: tuple[float, float]
    """Magnitudes of current not exceeded 90 and 99 % of the session, A."""


def scale_of(device: str | Lab, seed: int, duration_s: float) -> Scale:
    """Sizes of a device and of the session that this seed plays."""
    nominal = devices.model(device) if isinstance(device, str) else device.nominal
    plant = nominal["plant"]
    played = generate([], seed, duration_s, device, step_s=4.0 * STEP_S)
    speeds, shown, currents = _motion(played)
    return Scale(
        inertia=plant["inertia"],
        viscous=plant["viscous"],
        coulomb=plant["coulomb"],
        breakaway=plant["coulomb"] / nominal["amplifier"]["torque_constant"],
        stiffness=played.stiffness,
        resolution=devices.resolution(nominal),
        period_s=1.0 / nominal["servo"]["rate_hz"],
        duration_s=duration_s,
        speed=float(np.quantile(speeds, 0.9)),
        top_speed=float(speeds.max()),
        travel=0.5 * float(np.ptp(shown)),
        limits=(float(np.quantile(currents, 0.9)), float(np.quantile(currents, 0.99))),
    )


def _motion(played: Recording) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.abs(played.states[:, 1]), played.states[:, 0], np.abs(played.current_command)


def draw(slug: str, x: Scale, rng: np.random.Generator) -> Recipe:
    """A recipe with its shape parameters and signs drawn.

    Raises:
        KeyError: an unknown slug.
    """
    shape = _SHAPES[slug](x, rng)
    return lambda strength: {"name": slug, **shape(strength)}


def wrong_base(slug: str, rng: np.random.Generator) -> Effect:
    """A base parameter that is wrong by 10 to 40 %."""
    return {"name": slug, "r": float(_sign(rng) * rng.uniform(0.1, 0.4))}


def _sign(rng: np.random.Generator) -> float:
    return 1.0 if rng.random() < 0.5 else -1.0


def _either(rng: np.random.Generator, up: float, down: float) -> float:
    return up if rng.random() < 0.5 else -down


def _times(name: str, size: float, **shape: float) -> Shape:
    return lambda s: {name: s * size, **{key: float(value) for key, value in shape.items()}}


def _over(name: str, size: float, power: float, **shape: float) -> Shape:
    return lambda s: {name: size / s**power, **{key: float(value) for key, value in shape.items()}}


def _phase(rng: np.random.Generator) -> float:
    return float(rng.uniform(-math.pi, math.pi))


def _presliding(x: Scale, rng: np.random.Generator) -> Shape:
    zeta = rng.uniform(0.2, 0.8)

    def parameters(s: float) -> dict[str, object]:
        breakaway = 26.0 * x.resolution * s
        return {"breakaway": breakaway, "sigma_1": 2.0 * zeta * math.sqrt(x.coulomb / breakaway * x.inertia)}

    return parameters


def _drag(x: Scale, rng: np.random.Generator) -> Shape:
    full = x.coulomb / x.speed**2
    # Below this the device drives itself at the session's highest speed, which no friction does.
    degressive = min(full, 0.9 * (x.coulomb + x.viscous * x.top_speed) / x.top_speed**2)
    return _times("d", _either(rng, full, degressive))


def _ripple(x: Scale, rng: np.random.Generator) -> Shape:
    orders = rng.choice([2, 3, 4, 7, 11, 12, 14, 28], size=rng.integers(1, 4), replace=False)
    sizes = rng.uniform(0.25, 0.4, orders.size) * x.coulomb
    phases = [_phase(rng) for _ in orders]
    return lambda s: {"orders": orders.tolist(), "amplitudes": [float(s * size) for size in sizes], "phases": phases}


def _saturation(x: Scale, rng: np.random.Generator) -> Shape:
    """The limit goes from the 99 % quantile of the current down to the 90 % one."""
    low, high = x.limits
    return lambda s: {"i_max": high + (low - high) * (s - WEAKEST) / (1.0 - WEAKEST)}


def _hand(x: Scale, rng: np.random.Generator) -> Shape:
    length = rng.uniform(0.2, 0.5)
    begin = rng.uniform(0.05, 0.95 - length)
    sizes = {
        "m_h": rng.uniform(2.0, 4.0) * x.inertia,
        "b_h": rng.uniform(5.0, 15.0) * x.viscous,
        "k_h": rng.uniform(0.3, 1.0) * x.stiffness,
    }
    grip = {
        "on_s": float(begin * x.duration_s),
        "off_s": float((begin + length) * x.duration_s),
        "rest": float(rng.uniform(-0.5, 0.5) * x.travel),
    }
    return lambda s: {**{name: float(s * size) for name, size in sizes.items()}, **grip}


_SHAPES: dict[str, Callable[[Scale, np.random.Generator], Shape]] = {
    "inertia_error": lambda x, rng: _times("r", _either(rng, 0.5, 0.4)),
    "viscous_friction": lambda x, rng: _times("r", _either(rng, 3.0, 0.9)),
    "coulomb_friction": lambda x, rng: _times("r", 0.5 * _sign(rng)),
    "torque_constant_error": lambda x, rng: _times("r", 0.3 * _sign(rng)),
    "asymmetric_coulomb": lambda x, rng: _times("a", 0.3 * _sign(rng)),
    "asymmetric_viscous": lambda x, rng: _times("a", 0.9 * _sign(rng)),
    "stribeck": lambda x, rng: _times("s", 0.6, omega_s=x.speed * rng.uniform(0.06, 0.24)),
    "presliding": _presliding,
    "quadratic_drag": _drag,
    "load_dependent_friction": lambda x, rng: _times("kappa", 0.3),
    "constant_bias": lambda x, rng: _times("tau_0", 0.3 * x.coulomb * _sign(rng)),
    "gravity": lambda x, rng: _times("m_g_l", 0.6 * x.coulomb, theta_0=_phase(rng)),
    "torque_ripple": _ripple,
    "return_spring": lambda x, rng: _times(
        "k_s", 0.6 * x.coulomb / x.travel, theta_0=x.travel * rng.uniform(-0.5, 0.5)
    ),
    "transport_delay": lambda x, rng: _times("t_d", 1.5 * x.period_s),
    "amplifier_lag": lambda x, rng: _over("f_a", 0.06 / x.period_s, 1.0, delta=rng.uniform(0.5, 1.0)),
    "current_saturation": _saturation,
    "dac_quantization": lambda x, rng: _times("q", 1.5 * x.breakaway),
    "backlash": lambda x, rng: _times("gap", 26.0 * x.resolution, load_share=rng.uniform(0.3, 0.5)),
    "flexible_coupling": lambda x, rng: _over(
        "f_r", 0.025 / x.period_s, 0.5, load_share=rng.uniform(0.3, 0.5), damping=rng.uniform(0.02, 0.1)
    ),
    "encoder_eccentricity": lambda x, rng: _times("e", 40.0 * x.resolution, phi=_phase(rng)),
    "dropped_samples": lambda x, rng: _times("p", 0.3),
    "thermal_drift": lambda x, rng: _times("r", _either(rng, 0.8, 0.5), t_w=x.duration_s * rng.uniform(0.2, 0.4)),
    "hand_impedance": _hand,
}
