"""The model as functions."""

from __future__ import annotations

from collections.abc import Sequence

from hapticd.export.plain.axis import Axis
from hapticd.export.plain.model import MODEL


def torque(x: float, v: float, i: float, t: float) -> float:
    """The torque or force that accelerates the inertia, at a position, velocity, motor current [A] and time [s]."""
    return Axis(MODEL).torque(x, v, i, t)


def simulate(
    time_s: Sequence[float], currents: Sequence[float], position: float = 0.0, velocity: float = 0.0
) -> list[float]:
    """The positions at some times under commands [A], each of which holds until the next one's time."""
    axis, positions = Axis(MODEL, position, velocity), [position]
    for k in range(len(time_s) - 1):
        axis.step(currents[k], time_s[k + 1] - time_s[k])
        positions.append(axis.position)
    return positions
