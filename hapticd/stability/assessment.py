"""Stability assessment of a configuration and a motion: the content of ``hapticd check``.

The verdict ``stable`` needs a proof (`hapticd.stability.theorems`) or an exploration in which every start came to rest
(`hapticd.stability.explore`). A region alone is not enough.

The motion is a release at rest from a deflection, or a velocity at the spring's origin. Without either, the answer is for
every speed, or ``depends`` if it differs with the speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from hapticd.config import Config
from hapticd.config.assumed import assumed
from hapticd.stability._damped import Damped, damped
from hapticd.stability.cautions import cautions
from hapticd.stability.criterion import criterion_margin, sampling_bound_ok, velocity_limit
from hapticd.stability.describing_function import LimitCycle, predicted_cycle, settled_cycle
from hapticd.stability.explore import CHECK, Effort, explore
from hapticd.stability.explored import Explored
from hapticd.stability.numbers import Dimensionless, Loop, loop_from_config
from hapticd.stability.regions import MEANING, region
from hapticd.stability.storage import equivalent_deflection
from hapticd.stability.theorems import Proof, proof_of
from hapticd.stability.tuning import Start, stiffness_max_dissipating, stiffness_max_passive

Verdict = Literal["stable", "depends", "buzzes", "unstable", "undecided"]

#: Regions of the paper in which motions die out by the criterion, if its numbers describe the whole loop.
CALM: Final = frozenset({"A", "E", "F1", "F1|F2"})
#: Regions in which an oscillation gains energy.
_SHAKES: Final = frozenset({"C", "D"})

#: Top speed in ticks per period up to which energies do not overflow.
_FASTEST: Final = 1e100
#: Amplitude in ticks below which a motion counts as the smallest disturbance.
_SMALLEST_AMPLITUDE: Final = 1e-9


@dataclass(frozen=True)
class Assessment:
    """The assessment of a configuration and a motion.

    Attributes:
        config: the configuration. latency_s: the driver's declared latency [s].
        loop: the configuration in SI units. numbers: its operating point.
        start: the motion; None for every motion. deflection, velocity: as requested, in ticks and ticks per period.
        xi_dot_max: velocity bound (13) of the motion; None without one.
        region: region of Fig. 3 or 5.
        proof: the proof that covers the loop; None without one. holds: whether it covers this motion, or every
            motion if none was requested.
        explored: result of the exploration; None if a proof makes it unnecessary, or no spring is rendered.
        verdict: the conclusion in one word.
        velocity_limit: largest ξ̇_max that dissipates (15), in ticks per period.
        stiffness_passive: largest passive K, at any speed. stiffness_dissipating: for this motion; None without one.
        cycle: the limit cycle in which the motion ends (describing function); None if it ends in none.
        damped: result with the virtual damping; None without any. Region, limits and margins are then those of the
            spring alone, and `cycle` is None.
        warnings: what the theory leaves out, in words. effort: of the exploration.
    """

    config: Config
    latency_s: float
    loop: Loop
    numbers: Dimensionless
    start: Start | None
    deflection: float | None
    velocity: float | None
    xi_dot_max: float | None
    region: str
    proof: Proof | None
    holds: bool
    explored: Explored | None
    verdict: Verdict
    velocity_limit: float
    stiffness_passive: float
    stiffness_dissipating: float | None
    cycle: LimitCycle | None
    damped: Damped | None
    warnings: tuple[str, ...]
    effort: Effort = CHECK

    @property
    def proven(self) -> bool:
        """Whether the proof holds, and none of its numbers is assumed."""
        return self.holds and not assumed(self.config)

    @property
    def document(self) -> dict[str, Any]:
        """The JSON keys of ``hapticd check``, without the advice; numbers may be infinite."""
        n = self.numbers
        hertz = self.loop.scales.omega_to_hz
        return {
            "mu": n.mu,
            "beta": n.beta,
            "sigma": n.sigma,
            "tau_d": n.tau_d,
            "kappa": n.kappa,
            "region": self.region,
            "meaning": MEANING[self.region],
            "verdict": self.verdict,
            "proven": self.proven,
            "explored": self.explored and self.explored.document,
            "xi_dot_max": self.xi_dot_max,
            "velocity_limit": self.velocity_limit,
            "count_speed": self.config.count_speed,
            "criterion_margin": {"paper": criterion_margin(n, self.xi_dot_max)},
            "stiffness_max": {"passive": self.stiffness_passive, "dissipating": self.stiffness_dissipating},
            "limit_cycle": {
                "predicted": self.cycle is not None,
                "amplitude_ticks": self.cycle and self.cycle.amplitude,
                "frequency_hz": self.cycle and hertz(self.cycle.omega),
            },
            "damping": self.damped and self.damped.document,
            "sampling_bound_ok": math.isinf(n.mu) or sampling_bound_ok(n),
            "warnings": list(self.warnings),
        }


def assess(
    config: Config,
    *,
    velocity: float | None = None,
    deflection: float | None = None,
    start: Start | None = None,
    latency_s: float = 0.0,
    effort: Effort = CHECK,
    jobs: int | None = 1,
    cycles: bool = True,
) -> Assessment:
    """Assess a configuration.

    Args:
        config: a resolved configuration.
        velocity: initial velocity at the origin, in coarse ticks per period.
        deflection: release at rest from here, in coarse ticks from the origin.
        start: instead of both, the motion in SI units.
        latency_s: the driver's declared sample-to-current latency in s.
        effort, jobs: of the exploration, if there is no proof.
        cycles: whether to compute the limit cycles of the describing function.

    Raises:
        ValueError: both a velocity and a deflection, or a motion beyond the range of floating point.
    """
    if velocity is not None and deflection is not None:
        raise ValueError("give a velocity or a deflection, not both")
    loop = loop_from_config(config, latency_s)
    numbers = loop.numbers
    if start is not None:
        xi, xi_dot = start.to_ticks(loop)
        deflection, velocity = (xi, None) if start.deflection else (None, xi_dot)
    elif velocity is not None or deflection is not None:
        # in SI units, which do not depend on the loop
        start = Start.in_ticks(loop, deflection=deflection or 0.0, velocity=velocity or 0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        xi_dot_max = None if start is None else start.xi_dot_max(loop)
    if xi_dot_max is not None and not xi_dot_max < _FASTEST:
        raise ValueError(f"a motion of {xi_dot_max:g} ticks per period is too large to compute; at most {_FASTEST:g}")
    where = region(numbers, xi_dot_max)
    with_damping = None
    if config.spring.damping > 0.0:
        with_damping = damped(config, loop)
    proof = proof_of(config, loop)
    holds = proof is not None and proof.margin(xi_dot_max) >= 0.0
    cycle = None if with_damping or not cycles else _cycle(numbers, deflection, velocity)
    explored = None
    if not holds and (loop.stiffness > 0.0 or with_damping is not None):
        motion = None if start is None else (deflection or 0.0, velocity or 0.0)
        explored = explore(config, loop=loop, motion=motion, effort=effort, jobs=jobs)
    return Assessment(
        config=config,
        latency_s=latency_s,
        loop=loop,
        numbers=numbers,
        start=start,
        deflection=deflection,
        velocity=velocity,
        xi_dot_max=xi_dot_max,
        region=where,
        proof=proof,
        holds=holds,
        explored=explored,
        verdict=_verdict(where, proof if start is None else None, explored),
        velocity_limit=velocity_limit(numbers),
        stiffness_passive=stiffness_max_passive(loop),
        stiffness_dissipating=None if start is None else stiffness_max_dissipating(loop, start),
        cycle=cycle,
        damped=with_damping,
        warnings=cautions(config, loop, xi_dot_max, deflection),
        effort=effort,
    )


def _verdict(where: str, proof: Proof | None, explored: Explored | None) -> Verdict:
    """The verdict; ``proof`` is that of slow motions, if no motion was requested."""
    if explored is None or explored.stable:
        return "stable"
    if proof is not None and proof.speed_limit > 0.0:
        return "depends"
    if explored.moving_on:
        return "unstable" if explored.growing or where in _SHAKES else "buzzes"
    return "undecided" if explored.undecided else "buzzes"


def _cycle(numbers: Dimensionless, deflection: float | None, velocity: float | None) -> LimitCycle | None:
    if math.isinf(numbers.mu):
        return None
    amplitude = abs(deflection or 0.0)
    if velocity:
        amplitude = float(equivalent_deflection(velocity, numbers.mu))
    return settled_cycle(numbers, amplitude) if amplitude > _SMALLEST_AMPLITUDE else predicted_cycle(numbers)
