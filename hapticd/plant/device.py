"""The device as a Python object, usable alone: methods for the kernels of :mod:`hapticd.plant.kernel`.

Time is in seconds, 0 at the creation of the object. Between two calls the motion is exact for any step:

>>> from hapticd.config import load_config
>>> from hapticd.plant.device import Plant
>>> plant = Plant.from_config(load_config(None))
>>> plant.command(1.0, time=0.0)  # 1 A into the winding, T_A later
>>> plant.advance(0.010)
>>> plant.counts
276
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from hapticd.plant import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.config import Config

Instant = tuple[int, float]
"""Whole nanoseconds, and the fraction of one in [0, 1)."""


def split_time(seconds: float) -> Instant:
    """Split a time in seconds into an instant, without loss of digits.

    Raises:
        ValueError: the time is not finite.
    """
    if not math.isfinite(seconds):
        raise ValueError(f"time {seconds} s is not finite")
    whole = math.floor(seconds)
    ns = (seconds - whole) * 1e9
    return whole * 1_000_000_000 + math.floor(ns), ns - math.floor(ns)


class Plant:
    """Amplifier, shaft, encoder and hand of one device.

    Args:
        buffer: memory of the device, from :func:`hapticd.plant.kernel.init_plant`; not copied.
    """

    def __init__(self, buffer: NDArray[np.float64]) -> None:
        self._f = buffer
        self._i = buffer.view(np.int64)
        self._schedule: deque[tuple[Instant, float]] = deque()

    @classmethod
    def from_config(cls, config: Config, position: float = 0.0, velocity: float = 0.0) -> Plant:
        """A device at time 0 with no current.

        Args:
            config: resolved configuration.
            position: initial position [rad or m].
            velocity: initial velocity [rad/s or m/s].
        """
        return cls(kernel.init_plant(config, position, velocity))

    def advance(self, time: float) -> None:
        """Move to a time [s]; a time that is not after `time` changes nothing.

        Raises:
            ValueError: the time is not finite.
        """
        ns, frac = split_time(time)
        while self._schedule and self._schedule[0][0] <= (ns, frac):
            instant, force = self._schedule.popleft()
            kernel.plant_advance(self._f, self._i, *instant)
            self.hand_force = force
        kernel.plant_advance(self._f, self._i, ns, frac)

    def command(self, current: float, time: float) -> None:
        """Move to a time [s] and command a current [A]; it acts on the motor T_A later.

        Raises:
            ValueError: the time is not finite.
            OverflowError: the queue of the amplifier's delay is full.
        """
        self.advance(time)
        lost = self._i[kernel.QUEUE_OVERFLOWS]
        kernel.plant_command(self._f, self._i, *split_time(time), current)
        if self._i[kernel.QUEUE_OVERFLOWS] != lost:
            raise OverflowError(f"{kernel.QUEUE_LENGTH} commands are already waiting in the amplifier's delay")

    def schedule_hand_force(self, times: Sequence[float], forces: Sequence[float]) -> None:
        """Apply a piecewise constant force: ``forces[k]`` exactly from ``times[k]`` on.

        It replaces an earlier schedule; until its first time the present `hand_force` acts.

        Args:
            times: rising times [s], from the present time on.
            forces: torques or forces [N m or N], of the same length.

        Raises:
            ValueError: the lengths differ, the times do not rise, or the first one is in the past.
        """
        if len(times) != len(forces):
            raise ValueError(f"{len(times)} times for {len(forces)} forces")
        instants = [split_time(time) for time in times]
        if any(later <= earlier for earlier, later in pairwise(instants)):
            raise ValueError("the times of a hand force schedule must rise")
        if instants and instants[0] < self._instant:
            raise ValueError(f"the schedule begins at {times[0]} s, before the present {self.time} s")
        self._schedule = deque(zip(instants, forces, strict=True))

    @property
    def _instant(self) -> Instant:
        return int(self._i[kernel.TIME_NS]), float(self._f[kernel.TIME_FRAC])

    @property
    def time(self) -> float:
        """Present time [s]."""
        ns, frac = self._instant
        return (ns + frac) / 1e9

    @property
    def position(self) -> float:
        """True position [rad or m]."""
        return float(self._f[kernel.POSITION])

    @property
    def velocity(self) -> float:
        """True velocity [rad/s or m/s]."""
        return float(self._f[kernel.VELOCITY])

    @property
    def current(self) -> float:
        """Current in the motor [A]."""
        return float(self._f[kernel.CURRENT])

    @property
    def counts(self) -> int:
        """Raw encoder counts."""
        return int(kernel.plant_counts(self._f, self._i))

    @property
    def hand_force(self) -> float:
        """External torque or force on the shaft [N m or N]; a new value acts from the present time on."""
        return float(self._f[kernel.HAND_FORCE])

    @hand_force.setter
    def hand_force(self, force: float) -> None:
        self._f[kernel.HAND_FORCE] = force

    @property
    def buffer(self) -> NDArray[np.float64]:
        """The device's memory, with the layout of :mod:`hapticd.plant.kernel`."""
        return self._f
