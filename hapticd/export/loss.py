"""What a URDF loses of a model, as motion: its joint beside hapticd's own plant, under the same current."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hapticd.export.axis_numbers import axis_numbers
from hapticd.export.plain.axis import Axis
from hapticd.export.plain.numbers import Numbers
from hapticd.plant import Plant, kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.config import Config

_PERIOD_S = 1e-3
_OVER_FRICTION = 5.0
"""Largest current in that which moves the axis from rest: slow and fast motion are both in it."""


@dataclass(frozen=True)
class Loss:
    """How far the joint is off in two seconds from rest.

    Attributes:
        share: largest error of the position, as a share of the travel. current_A: largest command.
    """

    share: float
    current_A: float

    @property
    def text(self) -> str:
        """A sentence."""
        return (
            f"in two seconds from rest under up to {self.current_A:.2g} A the URDF's joint is off by up to "
            f"{100 * self.share:.2g} % of the travel"
        )


def loss_of_urdf(config: Config) -> Loss:
    """Move a config's plant and the joint that its URDF describes (inertia, friction, damping, gravity, effort) alike."""
    commands, whole = excitation(config), axis_numbers(config)
    joint = Axis(
        Numbers(
            inertia=whole.inertia,
            torque_constant=whole.torque_constant,
            viscous=whole.viscous,
            damping=whole.damping,
            coulomb=whole.coulomb,
            gravity=whole.gravity,
            gravity_rest=whole.gravity_rest,
            current_limit=whole.current_limit,
        )
    )
    plant = Plant(kernel.init_plant(config, 0.0, 0.0, current_loop=True))
    right, near = np.empty(commands.size), np.empty(commands.size)
    for k, command in enumerate(commands.tolist()):
        plant.command(command, k * _PERIOD_S)
        plant.advance((k + 1) * _PERIOD_S)
        joint.step(command, _PERIOD_S)
        right[k], near[k] = plant.position, joint.position
    travel = float(np.ptp(right))
    return Loss(float(np.abs(near - right).max()) / travel if travel else 0.0, float(np.abs(commands).max()))


def excitation(config: Config) -> NDArray[np.float64]:
    """Commands, A, one a millisecond for two seconds: a sweep on a square wave, both ways, with a rest."""
    n = axis_numbers(config)
    held = n.coulomb * (1.0 + max(n.stribeck_share, 0.0)) / n.torque_constant
    most = min(_OVER_FRICTION * held if held else 1.0, n.current_limit)
    t = np.arange(2000) * _PERIOD_S
    current = 0.6 * np.sin(2 * np.pi * (1.0 + 1.5 * t) * t) + 0.4 * np.sign(np.sin(2 * np.pi * 1.7 * t + 0.3))
    current[(t > 0.9) & (t < 1.05)] = 0.0
    return np.asarray(most * current)
