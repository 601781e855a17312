"""How an effect is drawn: its shape parameters by chance, its size by how visible it is.

A recipe turns one number, the amount in (0, 1], into the effect's parameters; sizes scale with the device. `sized` finds
the amount at which a perfect observer sees the wanted visibility (`generate.visibility`): nothing that the workflow finds
or fails to find has a part in it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from benchmarks.gap import devices
from benchmarks.gap.generate import STEP_S, UnstableError, generate, visibility
from benchmarks.gap.hidden import Effect

VISIBILITY = {"barely": 0.3, "clear": 1.5, "strong": 6.0}
"""Strength to the visibility that is aimed at; a perfect observer's gaps are 1.04, 1.8 and 6.1."""

ROTARY_ONLY = ("gravity", "torque_ripple", "encoder_eccentricity")
_LEAST_AMOUNT = 1e-4
_TOLERANCE = 0.1
_MOST_TRIALS = 14

Recipe = Callable[[float], Effect]


class Scale(NamedTuple):
    """What sizes are relative to."""

    inertia: float
    viscous: float
    coulomb: float
    breakaway: float
    """Current that overcomes friction, A."""
    stiffness: float
    resolution: float
    period_s: float
    speed: float
    """The largest in a session."""


def scale_of(device: str) -> Scale:
    """Sizes of a device's nominal model."""
    nominal = devices.model(device)
    plant = nominal["plant"]
    return Scale(
        inertia=plant["inertia"],
        viscous=plant["viscous"],
        coulomb=plant["coulomb"],
        breakaway=plant["coulomb"] / nominal["amplifier"]["torque_constant"],
        stiffness=nominal["spring"]["stiffness"],
        resolution=devices.resolution(nominal),
        period_s=1.0 / nominal["servo"]["rate_hz"],
        speed=devices.LAB_SPEED[device],
    )


def _either(rng: np.random.Generator, up: float, down: float) -> float:
    return up if rng.random() < 0.5 else -down


def _grip(rng: np.random.Generator, duration_s: float) -> dict[str, float]:
    begin = rng.uniform(0.1, 0.5)
    end = begin + rng.uniform(0.2, 0.4)
    return {"on_s": float(begin * duration_s), "off_s": float(end * duration_s)}


def _ripple(rng: np.random.Generator, x: Scale) -> Callable[[float], dict[str, object]]:
    orders = rng.choice([2, 3, 4, 7, 11, 12, 14, 28], size=rng.integers(1, 3), replace=False)
    sizes = [0.8 * x.coulomb * 0.6**number for number in range(orders.size)]
    phases = [float(rng.uniform(-math.pi, math.pi)) for _ in orders]
    return lambda a: {"orders": orders.tolist(), "amplitudes": [a * size for size in sizes], "phases": phases}


def _presliding(rng: np.random.Generator, x: Scale) -> Callable[[float], dict[str, object]]:
    zeta = rng.uniform(0.2, 0.8)

    def parameters(a: float) -> dict[str, object]:
        breakaway = 60.0 * x.resolution * a
        return {"breakaway": breakaway, "sigma_1": 2.0 * zeta * math.sqrt(x.coulomb / breakaway * x.inertia)}

    return parameters


def draw(slug: str, device: str, rng: np.random.Generator, duration_s: float) -> Recipe:
    """A recipe with its shape parameters and signs drawn.

    Raises:
        KeyError: an unknown slug.
    """
    x = scale_of(device)
    theta = float(rng.uniform(-2.0, 2.0)) * x.coulomb / x.stiffness
    phase = float(rng.uniform(-math.pi, math.pi))
    share = float(rng.uniform(0.2, 0.6))
    degressive = 0.9 * (x.coulomb + x.viscous * x.speed) / x.speed**2
    recipes: dict[str, Callable[[], Callable[[float], dict[str, object]]]] = {
        "inertia_error": lambda: _times("r", _either(rng, 4.0, 0.8)),
        "viscous_friction": lambda: _times("r", _either(rng, 20.0, 1.0)),
        "coulomb_friction": lambda: _times("r", _either(rng, 5.0, 1.0)),
        "torque_constant_error": lambda: _times("r", _either(rng, 4.0, 0.8)),
        "asymmetric_coulomb": lambda: _times("a", _either(rng, 0.9, 0.9)),
        "asymmetric_viscous": lambda: _times("a", _either(rng, 0.95, 0.95)),
        "stribeck": lambda: _times("s", 1.5, omega_s=x.speed * 10 ** rng.uniform(-2.0, -1.0)),
        "presliding": lambda: _presliding(rng, x),
        "quadratic_drag": lambda: _times("d", _either(rng, 180.0 * x.coulomb / x.speed**2, degressive)),
        "load_dependent_friction": lambda: _times("kappa", 0.6),
        "constant_bias": lambda: _times("tau_0", _either(rng, 0.8 * x.coulomb, 0.8 * x.coulomb)),
        "gravity": lambda: _times("m_g_l", 1.5 * x.coulomb, theta_0=phase),
        "torque_ripple": lambda: _ripple(rng, x),
        "return_spring": lambda: _times("k_s", 2.0 * x.stiffness, theta_0=theta),
        "transport_delay": lambda: _times("t_d", 10.0 * x.period_s),
        "amplifier_lag": lambda: _over("f_a", 0.01 / x.period_s, delta=rng.uniform(0.5, 1.0)),
        "current_saturation": lambda: _over("i_max", 0.8 * x.breakaway),
        "dac_quantization": lambda: _times("q", 2.0 * x.breakaway),
        "backlash": lambda: _times("gap", 400.0 * x.resolution, load_share=share),
        "flexible_coupling": lambda: _over("f_r", 0.015 / x.period_s, load_share=share, damping=rng.uniform(0.02, 0.1)),
        "encoder_eccentricity": lambda: _times("e", 100.0 * x.resolution, phi=phase),
        "dropped_samples": lambda: _times("p", 0.5),
        "thermal_drift": lambda: _times("r", _either(rng, 3.0, 0.9), t_w=rng.uniform(3.0, 15.0)),
        "hand_impedance": lambda: _hand(x, rest=theta, **_grip(rng, duration_s)),
    }
    parameters = recipes[slug]()
    return lambda amount: {"name": slug, **parameters(amount)}


def _off(value: float, wanted: float) -> float:
    return abs(math.log(max(value, 1e-9) / wanted))


def _times(name: str, size: float, **shape: float) -> Callable[[float], dict[str, object]]:
    return lambda a: {name: a * size, **{key: float(value) for key, value in shape.items()}}


def _over(name: str, size: float, **shape: float) -> Callable[[float], dict[str, object]]:
    return lambda a: {name: size / a, **{key: float(value) for key, value in shape.items()}}


def _hand(x: Scale, **grip: float) -> Callable[[float], dict[str, object]]:
    return lambda a: {
        "m_h": 3.0 * a * x.inertia,
        "b_h": 10.0 * a * x.viscous,
        "k_h": a * x.stiffness,
        **grip,
    }


def sized(recipe: Recipe, wanted: float, seed: int, duration_s: float, device: str) -> tuple[Effect, float]:
    """The effect of a recipe whose visibility is the wanted one, or the largest that the recipe admits.

    Args:
        recipe: from `draw`.
        wanted: visibility.
        seed: of the session in which it will be hidden.
        duration_s: of that session.
        device: one of `devices.MODELS`.

    Returns:
        The effect and its visibility.

    Raises:
        UnstableError: no amount leaves the session possible.
    """

    def seen(amount: float) -> float:
        try:
            recording = generate([recipe(amount)], seed, duration_s, device, step_s=4.0 * STEP_S)
        except UnstableError:
            return math.inf
        return visibility(recording, step_s=4.0 * STEP_S)

    low, high = math.log(_LEAST_AMOUNT), 0.0
    best, found = 0.0, seen(1.0)
    if found > wanted:
        best, found = low, seen(_LEAST_AMOUNT)
        for _ in range(_MOST_TRIALS):
            trial = 0.5 * (low + high)
            value = seen(math.exp(trial))
            if math.isfinite(value) and _off(value, wanted) < _off(found, wanted):
                best, found = trial, value
            if _off(found, wanted) < _TOLERANCE:
                break
            low, high = (trial, high) if value < wanted else (low, trial)
    if not math.isfinite(found):
        raise UnstableError(f"{recipe(1.0)['name']} on {device}, seed {seed}")
    return recipe(math.exp(best)), found
