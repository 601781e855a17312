"""The effects as columns of the balance of forces: the torque each adds, per unit of its linear coefficients.

An effect whose law is linear in its parameters (or becomes so by an expansion about its neutral value) is a few columns,
before filtering. What is not linear in it (an angular order, a velocity, a time constant) is a value from a grid; a
design is the effect at one such value. Laws and signs: docs/effects. Effects that leave no trace in a balance of
forces that is linear in anything (presliding, backlash, flexible coupling, dropped samples) have no columns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.smooth import acceleration_of, velocity_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.config import Config
    from hapticd.gap.force import ForceSignals

    FloatArray = NDArray[np.float64]
    Columns = dict[str, FloatArray]
    Build = Callable[[ForceSignals, Config, float], Columns]

_GRID = 12
_LARGEST_ORDER = 128


@dataclass(frozen=True)
class Effect:
    """How an effect enters the balance of forces.

    Attributes:
        build: columns (n,) by coefficient for one value of the nonlinear parameter.
        nonlinear: name of the parameter that is not linear; empty for none.
        grid: its values for these signals.
        rotary_only: an angle makes no sense on a linear device.
        bounds: coefficient → what the law allows it.
    """

    build: Build
    nonlinear: str = ""
    grid: Callable[[ForceSignals], FloatArray] = lambda signals: np.zeros(1)
    rotary_only: bool = False
    bounds: dict[str, tuple[float, float]] = field(default_factory=dict)


def _speeds(signals: ForceSignals) -> FloatArray:
    """Values between the speeds that occur: a tenth of the median to the largest."""
    speed = np.abs(signals.motion.velocity[signals.moving])
    low, high = np.quantile(speed, [0.05, 0.99])
    return np.geomspace(max(low, 1e-3 * high), max(high, 1e-300), _GRID)


def _times(signals: ForceSignals) -> FloatArray:
    span = float(signals.motion.time_s[-1])
    return np.geomspace(span / 20.0, span, _GRID)


def _currents(signals: ForceSignals) -> FloatArray:
    return np.quantile(np.abs(signals.current), np.linspace(0.5, 0.99, _GRID))


def _torque_constant(s: ForceSignals, model: Config, unused: float) -> Columns:
    """K_t (1 + r) i = J a + b v + c sgn(v), divided by 1 + r: the passive torques, by rho = r / (1 + r).

    The drive itself as a column would explain any residual by r = -1, with nothing left to balance.
    """
    plant = model.plant
    return {"rho": plant.inertia * s.acceleration + plant.viscous * s.velocity + plant.coulomb * s.direction}


def _stribeck(s: ForceSignals, model: Config, speed: float) -> Columns:
    return {"s_c": -s.direction * np.exp(-((s.motion.velocity / speed) ** 2))}


def _saturation(s: ForceSignals, model: Config, limit: float) -> Columns:
    clipped = np.clip(s.current, -limit, limit) - s.current
    return {"clip": model.amplifier.torque_constant * clipped}


def _eccentricity(s: ForceSignals, model: Config, unused: float) -> Columns:
    """A measured angle θ + e sin(θ + φ) makes the balance see the motion of e sin(θ + φ) besides."""
    columns = {}
    for name, wave in (("e_cos", np.sin(s.motion.position)), ("e_sin", np.cos(s.motion.position))):
        rate, second = velocity_of(wave, s.motion.period_s), acceleration_of(wave, s.motion.period_s)
        columns[name] = model.plant.inertia * second + model.plant.viscous * rate
    return columns


def _segments(signals: ForceSignals) -> FloatArray:
    """Edges of the segments of which an interval of grip is made, s."""
    return np.linspace(0.0, float(signals.motion.time_s[-1]), _GRID + 1)


def _hand(s: ForceSignals, model: Config, segment: float) -> Columns:
    edges = _segments(s)
    inside = (s.motion.time_s >= edges[int(segment)]) & (s.motion.time_s < edges[int(segment) + 1])
    return {
        "m_h": -s.acceleration * inside,
        "b_h": -s.velocity * inside,
        "k_h": -s.motion.position * inside,
        "k_h_theta_0": 1.0 * inside,
    }


def ripple(s: ForceSignals, model: Config, order: float) -> Columns:
    """Sine and cosine of one order per revolution."""
    angle = order * s.motion.position
    return {f"a_{order:g}_sin": np.sin(angle), f"a_{order:g}_cos": np.cos(angle)}


EFFECTS: dict[str, Effect] = {
    "inertia_error": Effect(lambda s, m, _: {"r": -m.plant.inertia * s.acceleration}),
    "viscous_friction": Effect(lambda s, m, _: {"r_b": -s.velocity}),
    "coulomb_friction": Effect(lambda s, m, _: {"r_c": -s.direction}),
    "torque_constant_error": Effect(_torque_constant),
    "constant_bias": Effect(lambda s, m, _: {"tau_0": np.ones_like(s.velocity)}),
    "asymmetric_viscous": Effect(lambda s, m, _: {"a_b": -np.abs(s.motion.velocity)}),
    "quadratic_drag": Effect(lambda s, m, _: {"d": -s.motion.velocity * np.abs(s.motion.velocity)}),
    "return_spring": Effect(
        lambda s, m, _: {"k_s": -s.motion.position, "k_s_theta_0": np.ones_like(s.velocity)},
        bounds={"k_s": (0.0, inf)},
    ),
    "gravity": Effect(
        lambda s, m, _: {"mgl_cos": -np.sin(s.motion.position), "mgl_sin": np.cos(s.motion.position)},
        rotary_only=True,
    ),
    "load_dependent_friction": Effect(
        lambda s, m, _: {"kappa": -np.abs(m.amplifier.torque_constant * s.current) * s.direction},
        bounds={"kappa": (0.0, 1.0)},
    ),
    "stribeck": Effect(_stribeck, "omega_s", _speeds),
    "thermal_drift": Effect(
        lambda s, m, t_w: {"r_c": -s.direction * (1.0 - np.exp(-s.motion.time_s / t_w))}, "t_w", _times
    ),
    "transport_delay": Effect(
        lambda s, m, _: {"t_d": -m.amplifier.torque_constant * s.current_rate}, bounds={"t_d": (0.0, inf)}
    ),
    "amplifier_lag": Effect(
        lambda s, m, _: {"t_a": -m.amplifier.torque_constant * s.current_rate}, bounds={"t_a": (0.0, inf)}
    ),
    "current_saturation": Effect(_saturation, "i_max", _currents, bounds={"clip": (0.7, 1.3)}),
    "encoder_eccentricity": Effect(_eccentricity, rotary_only=True),
    "hand_impedance": Effect(
        _hand,
        "t_on",
        _segments,
        bounds={"k_h": (0.0, inf)},
    ),
    "torque_ripple": Effect(ripple, "k", lambda s: np.arange(1.0, _LARGEST_ORDER + 1.0), rotary_only=True),
}
"""Effects by slug. Orders of ``torque_ripple`` and the interval of ``hand_impedance`` are searched for (`force_search`)."""

IDENTICAL: tuple[frozenset[str], ...] = (
    frozenset({"constant_bias", "asymmetric_coulomb"}),
    frozenset({"transport_delay", "amplifier_lag"}),
)
"""Effects with the same columns: the balance of forces cannot tell them apart at all."""

BASE = ("inertia_error", "viscous_friction", "coulomb_friction", "torque_constant_error")
"""Effects that are corrections of the base model: with the base free there is nothing left of them."""


def screened(signals: ForceSignals, *, linear: bool, refit_base: bool) -> Iterator[str]:
    """Slugs that have columns on this device."""
    for slug, effect in EFFECTS.items():
        if not (linear and effect.rotary_only) and not (refit_base and slug in BASE):
            yield slug


def filtered_columns(signals: ForceSignals, model: Config, slug: str, value: float) -> Columns:
    """Columns (m,) of an effect at one value of its nonlinear parameter, filtered like the force."""
    built = EFFECTS[slug].build(signals, model, value)
    return {name: signals.filtered(column) for name, column in built.items()}
