"""Every effect, strong enough to show; one excitation; hapticd's own plant as the reference."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.config import Config, parse_config
from hapticd.effects.catalogue import OWN_SLUGS
from hapticd.plant import Plant, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

PERIOD_S = 1e-3
POSITION, VELOCITY = 0.1, 5.0
PARAMETERS: dict[str, dict[str, Any]] = {
    "inertia_error": {"r": 0.5},
    "viscous_friction": {"r": 3.0},
    "coulomb_friction": {"r": 0.5},
    "torque_constant_error": {"r": 0.3},
    "asymmetric_coulomb": {"a": 0.2},
    "asymmetric_viscous": {"a": 0.3},
    "stribeck": {"s": 1.0, "omega_s": 20.0},
    "presliding": {"breakaway": 0.5, "sigma_1": 1e-5},
    "quadratic_drag": {"d": 2e-7},
    "load_dependent_friction": {"kappa": 0.1},
    "constant_bias": {"tau_0": 3e-4},
    "gravity": {"m_g_l": 3e-3, "theta_0": 0.4},
    "torque_ripple": {"orders": [1, 3], "amplitudes": [2e-3, 1e-3], "phases": [0.3, 1.2], "current_proportion": 0.3},
    "return_spring": {"k_s": 1e-3, "theta_0": 0.5},
    "transport_delay": {"t_d": 2.05e-2},
    "amplifier_lag": {"f_a": 10.0, "delta": 0.5},
    "current_saturation": {"i_max": 0.2},
    "dac_quantization": {"q": 0.15},
    "backlash": {"gap": 2.0, "load_share": 0.6, "restitution": 0.3},
    "flexible_coupling": {"f_r": 3.0, "load_share": 0.5},
    "encoder_eccentricity": {"e": 0.9, "phi": 0.3},
    "dropped_samples": {"p": 0.1},
    "thermal_drift": {"r": 0.4, "t_w": 1.0},
    "hand_impedance": {"m_h": 2e-6, "b_h": 1e-4, "k_h": 0.01, "on_s": 0.3, "off_s": 1.2},
}
MORE: dict[str, list[dict[str, Any]]] = {
    "nothing": [],
    "degressive": [{"name": "quadratic_drag", "d": -2e-7}],
    "several": [
        {"name": name, **PARAMETERS[name]} for name in ("stribeck", "gravity", "transport_delay", "thermal_drift")
    ],
    "bristle behind a coupling": [{"name": name, **PARAMETERS[name]} for name in ("presliding", "flexible_coupling")],
}
CASES = {**{slug: [{"name": slug, **PARAMETERS[slug]}] for slug in OWN_SLUGS}, **MORE}


def config_of(case: str, **settings: Any) -> Config:
    """The RE35 with a case's effects."""
    plant = {"inertia": 6.28e-6, "viscous": 9e-6, "coulomb": 2e-3, "effects": CASES[case]}
    return parse_config({"plant": plant, **settings}, case)


def commands() -> NDArray[np.float64]:
    """Two seconds, A: both ways, slow and fast, with a rest."""
    t = np.arange(2000) * PERIOD_S
    current = 0.18 * np.sin(2 * np.pi * (1.0 + 1.5 * t) * t) + 0.12 * np.sign(np.sin(2 * np.pi * 1.7 * t + 0.3))
    current[(t > 0.9) & (t < 1.05)] = 0.0
    return current


def reference(
    config: Config,
    currents: NDArray[np.float64] | None = None,
    position: float = POSITION,
    velocity: float = VELOCITY,
) -> NDArray[np.float64]:
    """Positions after each command, as the simulated testbed has them; with an eccentric encoder those it sees."""
    plant = Plant(kernel.init_plant(config, position, velocity, current_loop=True))
    positions = []
    for k, current in enumerate((commands() if currents is None else currents).tolist()):
        plant.command(current, k * PERIOD_S)
        plant.advance((k + 1) * PERIOD_S)
        positions.append(plant.position)
    return np.array(positions)


def off_by(positions: NDArray[np.float64], right: NDArray[np.float64]) -> float:
    """Largest error, as a share of the travel."""
    return float(np.abs(positions - right).max() / np.ptp(right))


def loaded(path: Path) -> ModuleType:
    """An exported module."""
    module = ModuleType(path.stem)
    sys.modules[path.stem] = module  # where dataclasses look
    exec(compile(path.read_text(), path, "exec"), module.__dict__)
    return module
