"""Table I in both directions: device, spring and interface in SI units and as dimensionless numbers.

Position is measured in encoder ticks Δ, time in sampling intervals T, force in the force of one tick KΔ. The parameters
of device and interface are μ = m/(KT²), β = b/(KT), σ = c/(KΔ), τ_D = T_D/T. Added to Table I: κ = k_H/K, for a hand with
the stiffness k_H, and q, the largest error of a commanded force: ½, more with dither and a coarse converter.

SI units: rotary devices rad, N m, kg m²; linear devices m, N, kg. The formulas are the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers import declared_step
from hapticd.effects.catalogue import CATALOGUE
from hapticd.plant.amplifier import converter_grid

if TYPE_CHECKING:
    from hapticd.config import Config

Signal = TypeVar("Signal", float, NDArray[np.float64])


@dataclass(frozen=True)
class Dimensionless:
    """The operating point of Table I.

    Attributes:
        mu: inertia μ = m/(KT²).
        beta: viscous friction β = b/(KT).
        sigma: Coulomb friction σ = c/(KΔ).
        tau_d: loop delay τ_D = T_D/T, the zero-order hold not included.
        kappa: stiffness of a hand in parallel, κ = k_H/K.
        quantum: q, the largest error of a commanded force, in ticks of force: ½ for eq. 2, more with dither or a converter.
    """

    mu: float
    beta: float
    sigma: float
    tau_d: float = 0.0
    kappa: float = 0.0
    quantum: float = 0.5

    def __post_init__(self) -> None:
        if not self.mu > 0.0:
            raise ValueError(f"mu must be positive, got {self.mu!r}")
        for name in ("beta", "sigma", "tau_d", "kappa", "quantum"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)!r}")

    @property
    def tau_l(self) -> float:
        """Total loop delay τ_L = ½ + τ_D: the zero-order hold counts as half a period (Sec. VII)."""
        return 0.5 + self.tau_d

    @property
    def omega_n(self) -> float:
        """Undamped natural frequency √((1 + κ)/μ) in rad per period (eq. 10)."""
        return math.sqrt((1.0 + self.kappa) / self.mu)


@dataclass(frozen=True)
class Scales:
    """The units of the dimensionless signals: one tick Δ, one interval T, the force of one tick KΔ.

    Attributes:
        stiffness: K in N m/rad or N/m.
        resolution: Δ in rad or m per (coarse) tick.
        period: T in s.
    """

    stiffness: float
    resolution: float
    period: float

    @property
    def force(self) -> float:
        """Force of one tick KΔ in N m or N."""
        return self.stiffness * self.resolution

    @property
    def energy(self) -> float:
        """Energy unit KΔ² in J."""
        return self.stiffness * self.resolution**2

    def time_to_tau(self, t: Signal) -> Signal:
        """Time t to τ = t/T."""
        return t / self.period

    def tau_to_time(self, tau: Signal) -> Signal:
        """Time τ to t = τT in s."""
        return tau * self.period

    def position_to_xi(self, x: Signal) -> Signal:
        """Position x to ξ = x/Δ."""
        return x / self.resolution

    def xi_to_position(self, xi: Signal) -> Signal:
        """Position ξ to x = ξΔ in rad or m."""
        return xi * self.resolution

    def velocity_to_xi_dot(self, v: Signal) -> Signal:
        """Velocity ẋ to ξ̇ = ẋT/Δ in ticks per period."""
        return v * (self.period / self.resolution)

    def xi_dot_to_velocity(self, xi_dot: Signal) -> Signal:
        """Velocity ξ̇ to ẋ = ξ̇Δ/T in rad/s or m/s."""
        return xi_dot * (self.resolution / self.period)

    def force_to_phi(self, f: Signal) -> Signal:
        """Force F to φ = F/(KΔ)."""
        return f / self.force

    def phi_to_force(self, phi: Signal) -> Signal:
        """Force φ to F = φKΔ in N m or N."""
        return phi * self.force

    def omega_to_hz(self, omega: Signal) -> Signal:
        """Angular frequency ω in rad per period to f = ω/(2πT) in Hz."""
        return omega / (2.0 * math.pi * self.period)


@dataclass(frozen=True)
class Loop:
    """Device, spring and interface in SI units: everything the operating point depends on.

    Attributes:
        inertia: m in kg m² or kg, positive.
        viscous: b in N m s/rad or N s/m.
        coulomb: c in N m or N.
        stiffness: K of the virtual spring in N m/rad or N/m; 0 means that there is no spring.
        resolution: Δ in rad or m per (coarse) tick.
        period: T in s.
        delay: T_D = T_A + T_V + the driver's declared latency, in s (eq. 6).
        hand_stiffness: k_H in N m/rad or N/m.
        damping: B of virtual damping in N m s/rad or N s/m, at the shaft.
        position_error: error of position dither, added to the encoder's ½ tick, in coarse ticks.
        force_error: largest other error of a commanded force (half a step of the converter, dither), N m or N.
    """

    inertia: float
    viscous: float
    coulomb: float
    stiffness: float
    resolution: float
    period: float
    delay: float = 0.0
    hand_stiffness: float = 0.0
    damping: float = 0.0
    position_error: float = 0.0
    force_error: float = 0.0

    @property
    def scales(self) -> Scales:
        """The units of the dimensionless signals."""
        return Scales(self.stiffness, self.resolution, self.period)

    @property
    def numbers(self) -> Dimensionless:
        """μ, β, σ, τ_D and κ of Table I; without a spring (K = 0) μ, β and σ are infinite."""
        if self.stiffness == 0.0:
            return Dimensionless(math.inf, math.inf, math.inf, self.delay / self.period, 0.0)
        return Dimensionless(
            mu=self.inertia / (self.stiffness * self.period**2),
            beta=self.viscous / (self.stiffness * self.period),
            sigma=self.coulomb / (self.stiffness * self.resolution),
            tau_d=self.delay / self.period,
            kappa=self.hand_stiffness / self.stiffness,
            quantum=0.5 + self.position_error + self.force_error / self.scales.force,
        )

    def with_hand(self, inertia: float = 0.0, damping: float = 0.0, stiffness: float = 0.0) -> Loop:
        """The same loop with a hand's inertia, damping and stiffness in parallel with the device's (Sec. III-B)."""
        return replace(
            self,
            inertia=self.inertia + inertia,
            viscous=self.viscous + damping,
            hand_stiffness=self.hand_stiffness + stiffness,
        )


def physical(numbers: Dimensionless, scales: Scales) -> Loop:
    """Table I from right to left: the SI loop with these numbers and scales."""
    K, T = scales.stiffness, scales.period
    return Loop(
        inertia=numbers.mu * K * T**2,
        viscous=numbers.beta * K * T,
        coulomb=numbers.sigma * scales.force,
        stiffness=K,
        resolution=scales.resolution,
        period=T,
        delay=numbers.tau_d * T,
        hand_stiffness=numbers.kappa * K,
        position_error=numbers.quantum - 0.5,
    )


def loop_from_config(config: Config, latency_s: float = 0.0) -> Loop:
    """The SI loop of a configuration, with the hand in parallel and those effects of the plant that the theory includes.

    Args:
        config: a resolved configuration.
        latency_s: the driver's declared sample-to-current latency in s, added to T_A + T_V.
    """
    loop = Loop(
        inertia=config.plant.inertia,
        viscous=config.plant.viscous,
        coulomb=config.plant.coulomb,
        stiffness=config.spring.stiffness,
        resolution=config.resolution,
        period=config.period,
        delay=config.amplifier.delay + config.delay.computation_s + latency_s,
        damping=config.spring.damping,
        position_error=_position_error(config),
        force_error=_force_error(config),
    )
    # Base parameters, delays, the smaller friction.
    for listed in config.plant.effects:
        effect = CATALOGUE[listed.name]
        if effect.in_loop is not None:
            loop = replace(loop, **effect.in_loop(loop, effect.complete(listed.model_extra or {})))
    return loop.with_hand(config.hand.inertia, config.hand.damping, config.hand.stiffness)


def _position_error(config: Config) -> float:
    """Largest shift of the tick by position dither of ±a: up to the next raw count, ⌈Na⌉/N."""
    if config.dither.target != "position":
        return 0.0
    N = config.encoder.decimation
    return math.ceil(N * config.dither.amplitude) / N


def _force_error(config: Config) -> float:
    """Half a step of the converter, or of the device if coarser, and current dither, as a force in N m or N."""
    amplifier = config.amplifier
    step = max(converter_grid(amplifier.dac_bits, amplifier.dac_full_scale)[0], declared_step(config))
    dither = config.dither.amplitude if config.dither.target == "current" else 0.0
    return (0.5 * step + dither) * amplifier.torque_constant


def from_config(config: Config, latency_s: float = 0.0) -> Dimensionless:
    """The operating point of a configuration; see `loop_from_config`."""
    return loop_from_config(config, latency_s).numbers
