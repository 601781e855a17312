"""Recordings of a known device for the tests of `identify`, by the little simulation of the gap workflow's tests."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from hapticd.config import Config
from hapticd.gap.recording import Recording

from ..gap import synthetic

BIAS = 2e-4
SECONDS = 6.0


@cache
def recorded(seed: int = 1, sign: int = 1) -> Recording:
    """A run of the device with a bias; with sign −1 the encoder counts the other way."""
    found = synthetic.run(lambda angle, velocity, time: BIAS, SECONDS, seed)
    return replace(found, position=sign * found.position, name=f"run{seed}")


def wrong_model(factor: float = 60.0) -> Config:
    """A config that is right in encoder and torque constant, and wrong in the plant."""
    return synthetic.model(
        inertia=synthetic.INERTIA * factor, viscous=synthetic.VISCOUS / factor, coulomb=synthetic.COULOMB * factor
    )
