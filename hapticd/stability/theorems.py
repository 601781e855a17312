"""Configurations and speeds that the proofs cover: the two theorems for every component of a loop.

The commanded force of sample h is −p(ξ(h)) − β_v v(h) + e(h). Of the spring p the proofs use only that its slope
lies between 0 and 1, so that S = ½μξ̇² + ½κξ² + ∫p covers two-sided and one-sided springs, with and without the half tick (p
about ξ = ½ then), and every current saturation. Cost of each component (derivation: docs/explanation/stability.md):

| in the loop | cost |
|---|---|
| ticks with or without the half tick, two-sided or one-sided | q = ½ |
| position dither of ±a ticks of N counts | q + ⌈Na⌉/N |
| current dither of ±a ticks of force | q + a |
| a converter with a step of s ticks of force | q + s/2 |
| saturation, a hand's stiffness | nothing |
| delay T_D | λ(τ_D) in place of ½ |
| virtual damping β_v, with the quantisation error g of its velocity | λ(τ_D, β_v), q + β_v g |
| the same, with the difference over n periods | S may rise once, in the first n periods |
| a second-order current loop instead of a delay | λ(τ + θ) and q weighted with its impulse response (`lagged`) |

Not covered: effects of the plant that add energy or lag, the passivity controller, a soft start.
If a number of the device is assumed (`hapticd.config.assumed`), a theorem that holds proves nothing for the device.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hapticd.config.assumed import assumed
from hapticd.effects.catalogue import CATALOGUE
from hapticd.stability._current_loop import current_loop, lagged
from hapticd.stability.criterion import lambda_
from hapticd.stability.damping import damper_from_config

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hapticd.config import Config
    from hapticd.stability.numbers import Dimensionless, Loop


@dataclass(frozen=True)
class Proof:
    """The proof for a loop.

    Attributes:
        numbers: the operating point. q: the largest error of its force, in ticks. lam: λ, its λ.
        offset: of the spring's origin from that of the ticks. late: additional time until the first force acts in full,
            after the delay, periods. differenced: (n − 1) β_v/2 and β_v Σ(1/j − 1/n), by which S may rise in the first n
            periods.
        periods: n. damps: whether there is a virtual damping.
        assumed: keys of the device that the config does not contain; with any of them nothing is proven.
    """

    numbers: Dimensionless
    q: float
    lam: float
    offset: float = 0.0
    late: float = 0.0
    differenced: tuple[float, float] = (0.0, 0.0)
    periods: int = 1
    damps: bool = False
    assumed: tuple[str, ...] = ()

    @property
    def speed_limit(self) -> float:
        """ξ̇_max (13) up to which S rises at most once, ticks per period, where `margin` is zero; 0: nothing is proven.

        `top_speed` solved for its argument; infinite if the proof holds at every speed.
        """
        missing, left = self.lam - self.numbers.beta, self.numbers.sigma - self.q
        a = 0.5 * self.numbers.mu - self.differenced[0]
        if left < 0.0 or a <= 0.0:
            return 0.0
        if missing <= 0.0:
            return math.inf
        u = left / missing
        late, once = self.late * u, self.offset * self.numbers.tau_d + self.differenced[1]
        square = late * late + 2.0 * u * (a * u - once)
        reach = math.sqrt(square) - late if square > 0.0 else 0.0
        return max(0.0, (reach - self.offset) / math.sqrt(self.numbers.mu))

    @property
    def words(self) -> str:
        """One sentence: up to which speed S cannot rise."""
        which = "theorem 1" if self.numbers.tau_d == 0.0 and not self.damps else "theorem 2"
        limit = self.speed_limit
        how = "at any speed" if math.isinf(limit) else f"up to {limit:.3g} ticks per period"
        says = f"would prove, if the assumed {', '.join(self.assumed)} were true," if self.assumed else "proves"
        text = f"{which} {says} that the energy S cannot rise {how} (λ = {self.lam:.3f}, q = {self.q:.3f})"
        if self.periods > 1:
            text += f", except in the first {self.periods} periods, whose velocity is a difference over fewer periods"
        return text

    def top_speed(self, xi_dot_max: float) -> float:
        """The speed that is never exceeded if S rises at most once.

        With ½μv² the energy (13), without the offset o of the origin, and u this speed, the one rise is linear and
        quadratic in u: ½μu² ≤ ½(√μ v + o)² + (o τ_D + (√μ v + o) late) u + (first periods of an averaged velocity).
        """
        quadratic, linear = self.differenced
        if self.offset == self.late == quadratic == 0.0:
            return xi_dot_max
        reach = math.sqrt(self.numbers.mu) * xi_dot_max + self.offset
        a = 0.5 * self.numbers.mu - quadratic
        if a <= 0.0:
            return math.inf
        b = self.offset * self.numbers.tau_d + reach * self.late + linear
        return (b + math.sqrt(b * b + 2.0 * a * reach * reach)) / (2.0 * a)

    def margin(self, xi_dot_max: float | None) -> float:
        """(β − λ)ξ̇_max + σ − q, or the least of β − λ and σ − q, for a motion with this bound (13); None: for any."""
        missing, left = self.lam - self.numbers.beta, self.numbers.sigma - self.q
        top = self.top_speed(0.0 if xi_dot_max is None else xi_dot_max)
        if math.isinf(top):
            return -math.inf
        return min(-missing, left) if xi_dot_max is None else left - max(0.0, missing) * top


def proof_of(config: Config, loop: Loop) -> Proof | None:
    """The proof that covers a configuration; None if there is none for any motion.

    Args:
        config: the configuration. loop: the same in SI units, with the driver's latency (or another loop of the same kind).
    """
    if loop.stiffness == 0.0 or next(unproven(config), None) is not None:
        return None
    numbers, spring = loop.numbers, config.spring
    q, grown = numbers.quantum, (0.0, 0.0)
    beta_v, n = 0.0, 1
    if spring.damping > 0.0:
        damper = damper_from_config(config, loop)
        beta_v, n = damper.beta_v, damper.periods
        q += beta_v * damper.grain
        if n > 1:
            grown = 0.5 * beta_v * (n - 1), beta_v * sum(1.0 / j - 1.0 / n for j in range(1, n))
    lam, late = float(lambda_(numbers.tau_d, beta_v)), 0.0
    before, natural, ratio = current_loop(config, loop)
    if natural:
        lam, gain, late = lagged(before, natural, ratio, beta_v)
        q *= gain
    offset = 0.0 if spring.half_tick_bias else 0.5
    return Proof(numbers, q, lam, offset, late, grown, n, beta_v > 0.0, assumed(config))


def proven(config: Config, loop: Loop, xi_dot_max: float | None) -> bool:
    """Whether a theorem holds for a configuration and a motion, and none of its numbers is assumed; see `holds`."""
    return not assumed(config) and holds(config, loop, xi_dot_max)


def holds(config: Config, loop: Loop, xi_dot_max: float | None) -> bool:
    """Whether a proof covers a configuration and a motion.

    Args:
        config: the configuration. loop: the same in SI units.
        xi_dot_max: velocity bound (13) of the motion, ticks per period; None for every motion.
    """
    proof = proof_of(config, loop)
    return proof is not None and proof.margin(xi_dot_max) >= 0.0


def unproven(config: Config) -> Iterator[str]:
    """Parts of a configuration that no proof covers, in words."""
    if outside := uncovered(config):
        yield f"plant.effects ({', '.join(outside)})"
    if config.safety.passivity == "control":
        yield "safety.passivity: control"


def uncovered(config: Config) -> list[str]:
    """Effects of the plant that are not exact edits of the loop for which the proofs hold."""
    return [
        listed.name
        for listed in config.plant.effects
        for effect in [CATALOGUE[listed.name]]
        if effect.in_loop is None or not effect.in_loop_exact or effect.acts_on == "force"
    ]
