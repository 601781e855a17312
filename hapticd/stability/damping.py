"""What theory says of virtual damping B: Colgate and Schenkel's bound, and the paper's criterion with a damper in it.

**Passivity** (J. E. Colgate, G. G. Schenkel, "Passivity of a class of sampled-data systems: application to haptic
interfaces", J. Robotic Systems 14, 1997). A device of viscous friction b that is driven through a zero-order hold by
H(z) = K + B D(z) is passive if and only if, for 0 ≤ θ ≤ π, 2 (1 − cos θ) b > T Re{(1 − e^(−jθ)) H(e^(jθ))}. Every
estimate of the velocity in use is a mean of backward differences, D = Σ w_k z^(1−k) (1 − z⁻¹)/T with Σ w_k = 1, and then

    b > KT/2 + γB,      γ = max over θ of −Σ w_k cos kθ,

γ = 1 for the difference over one period (their b > KT/2 + |B|), less for any other. Late forces ask for K T_D more, and
what γ gains is then not counted. The bound knows no encoder and no Coulomb friction.

**Dissipation.** In the paper's argument (Sec. VI) the damper is one more error of the held force. It is at most
β_v (ξ̇_max + g), β_v = B/(KT): the mean of differences never exceeds the top speed by more than the grain g that ticks give
it, 1/n of the difference over n periods and 1 − a of the low-pass. So every form of the criterion holds with

    σ + βv ≥ w(v) + τ_D · (largest speed one delay earlier) + β_v (ξ̇_max + g),

which for high speeds is β ≥ ½ + τ_D + β_v, Colgate and Schenkel's, and at rest σ ≥ ½ + β_v g: a damper's ticks must be held
too. In both, a damper only costs. No theorem covers its braking; `hapticd.stability.sampled_loop` simulates it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from hapticd.stability.criterion import Criterion, dissipation_margin, xi_ddot_bound
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
        keep: a, the fraction of the estimate that a period leaves; 0 for the plain difference.
    """

    beta_v: float
    periods: int = 1
    keep: float = 0.0

    @property
    def grain(self) -> float:
        """Largest error that ticks give the estimate, in ticks per period: 1/n, or 1 − a."""
        return (1.0 - self.keep) / self.periods

    @property
    def gamma(self) -> float:
        """γ: the damping that the damper itself asks of the device, as a fraction of B."""
        if self.keep > 0.0:
            return (1.0 - self.keep) / (1.0 + self.keep)
        return _gamma_of_difference(self.periods)

    def passive_gamma(self, delay: float) -> float:
        """γ as it counts for passivity: 1 where there is delay."""
        return 1.0 if delay > 0.0 else self.gamma


def velocity_filter(spring: Spring, period_s: float) -> tuple[int, float]:
    """Periods n over which positions are differenced, and the fraction a = e^(−2π f T) of the estimate that stays."""
    if spring.velocity_estimate == "difference":
        return spring.velocity_periods, 0.0
    return 1, math.exp(-2.0 * math.pi * spring.velocity_cutoff_hz * period_s)


def damper_from_config(config: Config, loop: Loop) -> Damper:
    """The damper of a configuration with a spring."""
    beta_v = config.spring.damping / (loop.stiffness * loop.period)
    return Damper(beta_v, *velocity_filter(config.spring, loop.period))


def _gamma_of_difference(periods: int) -> float:
    """Max over θ of −(1/n) Σ cos kθ, k = 1 … n, by its closed form (1 − D_n(θ))/(2n), D_n the Dirichlet kernel."""
    if periods == 1:
        return 1.0
    theta = _ANGLES[1:]
    kernel = np.sin((periods + 0.5) * theta) / np.sin(0.5 * theta)
    return float((0.5 * (1.0 - kernel) / periods).max())


def passive_beta(numbers: Dimensionless, damper: Damper) -> float:
    """Least β for passivity: ½ + τ_D + γβ_v, with γ = 1 where there is delay."""
    return 0.5 + numbers.tau_d + damper.passive_gamma(numbers.tau_d) * damper.beta_v


def passive_viscous(config: Config, latency_s: float = 0.0) -> float:
    """Least viscous friction b in N m s/rad or N s/m for passivity, K(T/2 + T_D) + γB, with or without a spring."""
    loop = loop_from_config(config, latency_s)
    gamma = Damper(0.0, *velocity_filter(config.spring, loop.period)).passive_gamma(loop.delay)
    return loop.stiffness * (0.5 * loop.period + loop.delay) + gamma * config.spring.damping


def damped_margin(numbers: Dimensionless, damper: Damper, xi_dot_max: float, criterion: Criterion = "sharp") -> float:
    """Margin of a dissipation criterion with a damper in the loop, in ticks' worth of force; ≥ 0 means that it holds."""
    n, error = numbers, damper.beta_v * (xi_dot_max + damper.grain)
    xi_ddot_max = xi_ddot_bound(n.mu, n.beta, n.sigma + error, xi_dot_max, n.kappa)
    margin = dissipation_margin(n.mu, n.beta, n.sigma, n.tau_d, xi_dot_max, criterion, xi_ddot_max, n.kappa)
    return float(margin) - error
