"""The config that somebody would have, and what of the device it lacks."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from benchmarks.gap.foreign.machines import Drawn, Rng, between
from benchmarks.gap.foreign.record import encoder
from benchmarks.gap.foreign.simulate import Floats, Motion, damping, kinetic

KINDS = ("identified", "identified, with its uncertainty", "guess")
_RESTS = 0.02
"""Of the largest speed: below, it is no motion."""


class Base(NamedTuple):
    """Inertia and the straight line of friction over speed that comes closest while the machine moves."""

    inertia: float
    viscous: float
    coulomb: float


def straight(drawn: Drawn, motion: Motion) -> Base:
    """The base of the machine."""
    speed = np.abs(motion.velocity)
    speed = speed[speed > _RESTS * speed.max()][::7]
    machine = drawn.machine._replace(asymmetry=0.0)
    friction = np.array([kinetic(machine, v) + damping(machine, v) * v for v in speed])
    (coulomb, viscous), *_ = np.linalg.lstsq(np.stack([np.ones_like(speed), speed], axis=1), friction, rcond=None)
    return Base(machine.inertia, max(float(viscous), 0.0), max(float(coulomb), 0.05 * machine.coulomb))


def drawn_base(true: Base, kind: str, rng: Rng) -> tuple[Base, Base]:
    """What the config says, and how sure it says it is (0: it does not say)."""
    if kind == "guess":
        wrong = Base(
            true.inertia * between(rng, 0.4, 2.5),
            true.viscous * between(rng, 0.3, 3.0),
            true.coulomb * between(rng, 0.4, 2.5),
        )
        return wrong, Base(0.0, 0.0, 0.0)
    shares = Base(0.02, 0.1, 0.05)
    said = Base(
        *(
            value * math.exp(share * float(np.clip(rng.normal(), -2.0, 2.0)))
            for value, share in zip(true, shares, strict=True)
        )
    )
    known = kind != "identified"
    return said, Base(*(value * share * known for value, share in zip(said, shares, strict=True)))


def config(drawn: Drawn, base: Base, sure: Base) -> dict[str, Any]:
    """model.yaml."""
    plant: dict[str, Any] = {name: float(f"{value:.4g}") for name, value in base._asdict().items()}
    if any(sure):
        plant["uncertainty"] = {name: float(f"{value:.3g}") for name, value in sure._asdict().items()}
    return {
        "servo": {"rate_hz": float(round(drawn.rate_hz))},
        "encoder": encoder(drawn),
        "amplifier": {
            "torque_constant": drawn.machine.torque_constant, "bandwidth_hz": 0, "dac_bits": 0, "dac_full_scale": 0,
            "continuous_current": None, "peak_current": None,
        },
        "plant": plant,
    }  # fmt: skip


def shares(drawn: Drawn, motion: Motion, base: Base, said: Base) -> dict[str, float]:
    """What is missing while the machine moves, over the motor's torque, RMS: of the config, of the best straight base.

    ``inertial`` is the share of the torque that accelerates.
    """
    moves = np.abs(motion.velocity) > _RESTS * np.abs(motion.velocity).max()
    torque = drawn.machine.torque_constant * motion.current
    acceleration = np.gradient(motion.velocity, drawn.tick_s)

    def rms(values: Floats) -> float:
        return float(np.sqrt(np.mean(values[moves] ** 2)))

    def left(one: Base) -> Floats:
        friction = one.viscous * motion.velocity + one.coulomb * np.sign(motion.velocity)
        return np.asarray(torque - one.inertia * acceleration - friction)

    whole = rms(torque)
    return {
        "config_lacks": rms(left(said)) / whole,
        "base_lacks": rms(left(base)) / whole,
        "inertial": rms(base.inertia * acceleration) / whole,
    }
