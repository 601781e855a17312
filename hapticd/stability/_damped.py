"""Passivity of a loop with virtual damping: Colgate and Schenkel's bound, with delay theorem 2."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

from hapticd.config import Config
from hapticd.stability.damping import Damper, damper_from_config, passive_beta
from hapticd.stability.numbers import Loop

#: 1/μ of a spring with an oscillation period longer than any run.
_TOO_SOFT: Final = 1e-14


@dataclass(frozen=True)
class Damped:
    """A loop with virtual damping.

    Attributes:
        damper: in the units of Table I.
        passive_least: b in N m s/rad or N s/m above which the loop is passive by Colgate and Schenkel, with delay by
            theorem 2; without ticks and Coulomb friction. viscous: b of device and hand.
    """

    damper: Damper
    passive_least: float
    viscous: float

    @property
    def passive(self) -> bool:
        """Whether the bound holds."""
        return self.viscous >= self.passive_least

    @property
    def document(self) -> dict[str, Any]:
        """The result as data, for ``hapticd check --json``."""
        return {
            "beta_v": self.damper.beta_v,
            "gamma": self.damper.gamma,
            "grain": self.damper.grain,
            "passive": {"viscous_least": self.passive_least, "viscous": self.viscous, "holds": self.passive},
        }


def damped(config: Config, loop: Loop) -> Damped:
    """Evaluate the bound for a loop with virtual damping.

    Args:
        config: with ``spring.damping`` above 0. loop: the same in SI units.
    """
    loop = sprung(loop)
    damper, numbers, scales = damper_from_config(config, loop), loop.numbers, loop.scales
    least = passive_beta(numbers, damper) * scales.stiffness * scales.period
    return Damped(damper, passive_least=least, viscous=loop.viscous)


def sprung(loop: Loop) -> Loop:
    """The loop; without a spring, with a negligibly soft one, so that its dimensionless numbers exist."""
    return loop if loop.stiffness > 0.0 else replace(loop, stiffness=_TOO_SOFT * loop.inertia / loop.period**2)
