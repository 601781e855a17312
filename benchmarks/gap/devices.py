"""The devices of the benchmark, as the lab's nominal model.yaml would have them.

A motor with the values of the paper's testbed, and others with other inertia, friction, resolution, torque constant, rate;
one of them linear.
"""

from __future__ import annotations

import math
from copy import deepcopy
from typing import Any

from benchmarks.gap.physics import Device

Model = dict[str, Any]

_AMPLIFIER = {
    "torque_constant": 0.0292,
    "continuous_current": 2.0,
    "peak_current": 6.0,
    "bandwidth_hz": 3000.0,
    "damping_ratio": 0.7,
    "dac_bits": 14,
    "dac_full_scale": 6.0,
}

MODELS: dict[str, Model] = {
    "re35": {
        "servo": {"rate_hz": 1000.0},
        "spring": {"stiffness": 0.012},
        "encoder": {"counts_per_rev": 8192},
        "amplifier": _AMPLIFIER,
        "plant": {"inertia": 6.28e-6, "viscous": 9.0e-6, "coulomb": 2.0e-3},
    },
    "coarse": {  # a small motor with a 500-line encoder
        "servo": {"rate_hz": 1000.0},
        "spring": {"stiffness": 0.001},
        "encoder": {"counts_per_rev": 2000},
        "amplifier": {**_AMPLIFIER, "torque_constant": 0.0163, "peak_current": 3.0, "dac_full_scale": 3.0, "dac_bits": 12},
        "plant": {"inertia": 1.1e-6, "viscous": 1.2e-6, "coulomb": 4.0e-4},
    },
    "heavy": {  # a geared axis: much inertia and friction, a fine encoder
        "servo": {"rate_hz": 1000.0},
        "spring": {"stiffness": 0.5},
        "encoder": {"counts_per_rev": 40000},
        "amplifier": {**_AMPLIFIER, "torque_constant": 0.24, "peak_current": 10.0, "dac_full_scale": 10.0},
        "plant": {"inertia": 4.0e-4, "viscous": 1.5e-3, "coulomb": 0.06},
    },
    "fast": {  # the testbed's motor at twice the rate on a better encoder
        "servo": {"rate_hz": 2000.0},
        "spring": {"stiffness": 0.012},
        "encoder": {"counts_per_rev": 20000},
        "amplifier": _AMPLIFIER,
        "plant": {"inertia": 9.5e-6, "viscous": 2.5e-5, "coulomb": 1.2e-3},
    },
    "linear": {  # a haptic desktop device, one axis; the amplifier is ideal and takes newtons
        "servo": {"rate_hz": 1000.0},
        "spring": {"stiffness": 17.0},
        "encoder": {"counts_per_metre": 34364.26},
        "amplifier": {
            "torque_constant": 1.0, "continuous_current": None, "peak_current": None,
            "bandwidth_hz": 0, "dac_bits": 0, "dac_full_scale": 0,
        },
        "plant": {"inertia": 0.072, "viscous": 0.05, "coulomb": 0.038},
        "safety": {"max_velocity": 4.0, "max_excursion": 0.5, "encoder_jump": 1000},
    },
}  # fmt: skip
_ROTARY_LIMITS = {"max_velocity": 400.0, "max_excursion": 10.0}

LAB_SPEED = {"re35": 120.0, "coarse": 120.0, "heavy": 40.0, "fast": 120.0, "linear": 1.5}
"""Above this a lab would make its excitation smaller, rad/s or m/s."""


def model(name: str) -> Model:
    """A copy of a device's nominal model, with its safety limits.

    Raises:
        KeyError: no device has this name.
    """
    found = deepcopy(MODELS[name])
    found.setdefault("safety", dict(_ROTARY_LIMITS))
    return found


def is_linear(nominal: Model) -> bool:
    """Whether positions are metres and forces newtons."""
    return "counts_per_metre" in nominal["encoder"]


def resolution(nominal: Model) -> float:
    """One raw count, rad or m."""
    encoder = nominal["encoder"]
    return 1.0 / encoder["counts_per_metre"] if is_linear(nominal) else 2.0 * math.pi / encoder["counts_per_rev"]


def dac_step(nominal: Model) -> float:
    """Step of the command's converter, A; 0 for an ideal one."""
    amplifier = nominal["amplifier"]
    return 2.0 * amplifier["dac_full_scale"] / 2 ** amplifier["dac_bits"] if amplifier["dac_bits"] else 0.0


def base_device(nominal: Model) -> Device:
    """The device as its nominal model has it, all effects neutral; the amplifier is the delay T_A = δ/(π f)."""
    plant, amplifier = nominal["plant"], nominal["amplifier"]
    bandwidth = amplifier["bandwidth_hz"]
    return Device(
        inertia=plant["inertia"],
        viscous=plant["viscous"],
        coulomb=plant["coulomb"],
        torque_constant=amplifier["torque_constant"],
        delay_s=amplifier["damping_ratio"] / (math.pi * bandwidth) if bandwidth else 0.0,
        resolution=resolution(nominal),
    )
