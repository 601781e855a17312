"""Symmetric limit cycles below one tick in closed form, which exploration must find: the relay locks to whole periods.

Below one tick the quantised spring (8) is a relay ±½ that switches at samples only. If the samples are positive p times
and then negative p times, the force is a square wave of half-period p, and the motion it makes is known in closed form:
after each switch the mass first slows down under ½ + σ to a turning point, then speeds up under ½ − σ. Such a cycle
exists if that motion has the signs it was assumed to have, that is, if its upward zero crossing lies in the one period
before the sample that switches: y(−τ_D − 1) < 0 < y(−τ_D), the time counted from the switch.

Usually this holds for several p at once, and the initial state decides. The describing function replaces the sampler by
half a period of delay and so finds one cycle between them: its ω is near one of the π/p, and not any of them exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from hapticd.plant.exact import phi_functions
from hapticd.stability.numbers import Dimensionless


@dataclass(frozen=True)
class LockedCycle:
    """A symmetric limit cycle of 2p periods.

    Attributes:
        half_period: p, in sampling periods.
        amplitude: half of peak to peak, in coarse ticks.
        omega: π/p in rad per period.
    """

    half_period: int
    amplitude: float
    omega: float


def locked_cycles(numbers: Dimensionless) -> list[LockedCycle]:
    """All symmetric limit cycles below one tick, shortest first; none where σ ≥ ½ or a hand adds a stiffness."""
    if numbers.sigma >= 0.5 or numbers.kappa > 0.0 or math.isinf(numbers.mu):
        return []
    cycles = []
    half_period = 1
    while (wave := _HalfWave(numbers, half_period)).amplitude < 1.0:
        if wave.position(numbers.tau_d + 1.0) < 0.0 < wave.position(numbers.tau_d):
            cycles.append(LockedCycle(half_period, wave.amplitude, math.pi / half_period))
        half_period += 1
    return cycles


class _HalfWave:
    """The periodic motion under a square wave of force ±½ with half-period p, symmetric about zero."""

    def __init__(self, numbers: Dimensionless, half_period: int) -> None:
        self._rate = numbers.beta / numbers.mu
        self._drive = (0.5 - numbers.sigma) / numbers.mu
        self._brake = (0.5 + numbers.sigma) / numbers.mu
        self._half_period = half_period
        # the time from the turning point to the next switch; the rest of the half-period is spent slowing down
        low, high = 0.0, float(half_period)
        while low < (middle := 0.5 * (low + high)) < high:
            low, high = (middle, high) if middle + self._stopping_time(middle) <= half_period else (low, middle)
        self._speeding = low
        self.amplitude = 0.5 * (self._sped(low) + self._slowed(half_period - low))

    def position(self, before_switch: float) -> float:
        """Position so long before the switch from +½ to −½, in ticks; about zero on average."""
        turns, time = divmod(before_switch, self._half_period)
        sign = -1.0 if turns % 2.0 else 1.0
        if time <= self._speeding:
            return sign * (self._sped(self._speeding - time) - self.amplitude)
        return sign * (self._slowed(time - self._speeding) - self.amplitude)

    def _stopping_time(self, speeding: float) -> float:
        speed = self._drive * speeding * phi_functions(-self._rate * speeding)[1]
        w = self._rate * speed / self._brake
        return speed / self._brake * (math.log1p(w) / w if w > 0.0 else 1.0)

    def _sped(self, time: float) -> float:
        """Way from rest under the net force ½ − σ."""
        return self._drive * time * time * phi_functions(-self._rate * time)[2]

    def _slowed(self, time: float) -> float:
        """Way to rest under the net force −(½ + σ), the time counted back from rest."""
        exponential, phi1, phi2 = phi_functions(-self._rate * time)
        return self._brake * time * time * (phi1 - phi2) / exponential  # φ₂(−z) = (φ₁(z) − φ₂(z))/eᶻ
