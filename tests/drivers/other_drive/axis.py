"""A motor with some inertia, damping and dry friction, and what flows in it: moved on in small steps as the clock goes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

_STEP_NS = 250_000


@dataclass
class Axis:
    """One rotary axis; SI units."""

    inertia: float = 6.3e-6
    viscous: float = 9e-6
    coulomb: float = 2e-3
    torque_constant: float = 0.0292
    current_gain: float = 1.0
    """Current in the motor over the drive's; −1: leads exchanged."""
    counts_per_turn: int = 8192
    angle: float = 0.0
    speed: float = 0.0
    current: float = 0.0
    hand: float = 0.0
    at_ns: int = 0
    offset: int = 0
    held_until_ns: int = 0
    """Until when the counter stands still."""
    _held: int = field(default=0)

    def move_to(self, now_ns: int) -> None:
        """Move on to an instant, CLOCK_MONOTONIC in ns."""
        while self.at_ns < now_ns:
            step_ns = min(_STEP_NS, now_ns - self.at_ns)
            h = 1e-9 * step_ns
            drive = self.torque_constant * self.current_gain * self.current + self.hand - self.viscous * self.speed
            speed = self.speed + h * drive / self.inertia
            brake = h * self.coulomb / self.inertia
            self.speed = math.copysign(max(abs(speed) - brake, 0.0), speed)
            self.angle += h * self.speed
            self.at_ns += step_ns

    @property
    def true_counts(self) -> int:
        """What an encoder without faults and of endless width shows."""
        return math.floor(self.angle / (2 * math.pi) * self.counts_per_turn) + self.offset

    @property
    def counter(self) -> int:
        """What the drive's own counter of 32 bits shows, signed."""
        if self.at_ns >= self.held_until_ns:
            self._held = self.true_counts
        return signed(self._held, 32)


def signed(value: int, bits: int) -> int:
    """The two's complement reading of the low bits of a number."""
    half = 1 << bits - 1
    return (value + half) % (1 << bits) - half


def approach(value: float, goal: float, most: float) -> float:
    """One step of a ramp: nearer to a goal by at most that much; 0: at once."""
    return goal if most == 0.0 or abs(goal - value) <= most else value + math.copysign(most, goal - value)


def held_within(value: float, limits: Sequence[float]) -> float:
    """Clipped to the smallest of some limits, both ways."""
    most = min(limits)
    return max(-most, min(most, value))
