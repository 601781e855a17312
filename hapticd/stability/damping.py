"""Passivity with virtual damping B: Colgate and Schenkel's bound, and its form with delay.

**Passivity** (J. E. Colgate, G. G. Schenkel, "Passivity of a class of sampled-data systems: application to haptic
interfaces", J. Robotic Systems 14, 1997). A device of viscous friction b that is driven through a zero-order hold by
H(z) = K + B D(z) is passive if and only if, for 0 ≤ θ ≤ π, 2 (1 − cos θ) b > T Re{(1 − e^(−jθ)) H(e^(jθ))}. Every
estimate of the velocity in use is a mean of backward differences, D = Σ w_k z^(1−k) (1 − z⁻¹)/T with Σ w_k = 1, and then

    b > KT/2 + γB,      γ = max over θ of −Σ w_k cos kθ,

γ = 1 for the difference over one period (their b > KT/2 + |B|), less for any other. With a delay, γ = 1 is sufficient, and
b > KT λ(τ_D, β_v) of theorem 2 (`hapticd.stability.criterion`), β_v = B/(KT); without a damper it is also necessary. The
bound leaves out encoder and Coulomb friction; `hapticd.stability.theorems` includes them, and there a damper only raises q
and λ. No theorem covers its dissipation; `hapticd.stability.sampled_loop` simulates it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from hapticd.stability.criterion import FloatArray, lambda_
from hapticd.stability.numbers import Dimensionless, Loop, loop_from_config

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.config.sections import Spring

_ANGLES: Final = np.linspace(0.0, math.pi, 20_001)


@dataclass(frozen=True)
class Damper:
    """Virtual damping and its velocity estimate in the units of Table I.

    Attributes:
        beta_v: β_v = B/(KT).
        periods: n, over which positions are differenced.
        keep: a, the fraction of the estimate that remains after a period; 0 for the plain difference.
    """

    beta_v: float
    periods: int = 1
    keep: float = 0.0

    @property
    def grain(self) -> float:
        """Largest error of the estimate due to quantisation, in ticks per period: 1/n, or 1 − a."""
        return (1.0 - self.keep) / self.periods

    @property
    def gamma(self) -> float:
        """γ: the viscous friction that the damper requires of the device, as a fraction of B."""
        if self.keep > 0.0:
            return (1.0 - self.keep) / (1.0 + self.keep)
        return _gamma_of_difference(self.periods)


def velocity_filter(spring: Spring, period_s: float) -> tuple[int, float]:
    """Periods n of the position difference, and the fraction a = e^(−2π f T) of the estimate that remains after a period."""
    if spring.velocity_estimate == "difference":
        return spring.velocity_periods, 0.0
    return 1, math.exp(-2.0 * math.pi * spring.velocity_cutoff_hz * period_s)


def damper_from_config(config: Config, loop: Loop) -> Damper:
    """The damper of a configuration with a spring."""
    return Damper(loop.damping / (loop.stiffness * loop.period), *velocity_filter(config.spring, loop.period))


def _gamma_of_difference(periods: int) -> float:
    """Max over θ of −(1/n) Σ cos kθ, k = 1 … n, by its closed form (1 − D_n(θ))/(2n), D_n the Dirichlet kernel."""
    if periods == 1:
        return 1.0
    theta = _ANGLES[1:]
    kernel = np.sin((periods + 0.5) * theta) / np.sin(0.5 * theta)
    return float((0.5 * (1.0 - kernel) / periods).max())


def passive_beta(numbers: Dimensionless, damper: Damper) -> float:
    """Smallest β for passivity: ½ + γβ_v, with delay λ(τ_D, β_v)."""
    if numbers.tau_d == 0.0:
        return 0.5 + damper.gamma * damper.beta_v
    return float(lambda_(numbers.tau_d, damper.beta_v))


def passive_viscous(config: Config, latency_s: float = 0.0) -> float:
    """Smallest viscous friction b in N m s/rad or N s/m for passivity, KT λ(τ_D, β_v), with or without a spring."""
    loop = loop_from_config(config, latency_s)
    K, T, B = loop.stiffness, loop.period, loop.damping
    if loop.delay == 0.0:
        return 0.5 * K * T + Damper(0.0, *velocity_filter(config.spring, T)).gamma * B
    x = K * (0.5 * T + loop.delay) + B
    return 0.5 * (x + math.sqrt(x * x + (K * T) ** 2 * _between(loop)))


def passive_stiffness(config: Config, loop: Loop, damping: FloatArray) -> FloatArray:
    """Largest K for passivity with each virtual damping B, 0 if none: `passive_viscous` solved for K.

    Args:
        config: for the velocity estimate. loop: in SI units; its stiffness is not used.
        damping: (n,) B in N m s/rad or N s/m.
    """
    b, T, h = loop.viscous, loop.period, 0.5 * loop.period + loop.delay
    if b == 0.0:
        return np.zeros_like(damping)
    gamma = Damper(0.0, *velocity_filter(config.spring, T)).gamma if loop.delay == 0.0 else 1.0
    left = np.maximum(0.0, b - gamma * damping)
    return np.asarray(2.0 * left / (h + np.sqrt(h * h + T * T * _between(loop) * left / b)))


def _between(loop: Loop) -> float:
    """f(1 − f) of the delay: 0 for a whole number of periods."""
    f = loop.delay / loop.period
    f -= math.floor(f)
    return f * (1.0 - f)
