"""What holds of a loop with virtual damping: Colgate and Schenkel's bound, the criterion, and the exact loop."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final, Literal

from hapticd.config import Config
from hapticd.stability.damping import Damper, damper_from_config, passive_beta
from hapticd.stability.numbers import Loop, Scales
from hapticd.stability.sampled_loop import ExactRun, exact_run, is_linearly_stable

#: Ticks per period from which the exact loop is run when no motion is asked about.
SPEEDS: Final = (1.0, 10.0, 100.0)
#: 1/μ of a spring whose own oscillation takes longer than any run.
_TOO_SOFT: Final = 1e-14


@dataclass(frozen=True)
class Damped:
    """A loop with virtual damping.

    Attributes:
        damper: it, in the units of Table I.
        passive_least: b in N m s/rad or N s/m above which the loop is passive by Colgate and Schenkel, with delay by
            theorem 2; ticks and Coulomb friction are not in it. viscous: what the device and the hand have.
        runs: the exact loop: the motion asked about, or one from each of `SPEEDS`.
        linearly_stable: whether it dies out without ticks and Coulomb friction; then nothing grows for ever.
    """

    damper: Damper
    passive_least: float
    viscous: float
    runs: tuple[ExactRun, ...]
    linearly_stable: bool

    @property
    def passive(self) -> bool:
        """Whether that bound holds."""
        return self.viscous >= self.passive_least

    @property
    def verdict(self) -> Literal["stable", "depends", "buzzes", "unstable"]:
        """What the exact loop says."""
        outcomes = [run.outcome for run in self.runs]
        if outcomes[0] == "growing":
            return "unstable"
        if "persistent" in outcomes:
            return "buzzes"
        if "growing" in outcomes or (len(self.runs) > 1 and not self.linearly_stable):
            return "depends"
        return "stable"

    @property
    def oscillation(self) -> float:
        """Amplitude in ticks of what the motion, or without one the slowest, ends in; infinite if it grows."""
        return float("inf") if self.runs[0].outcome == "growing" else self.runs[0].amplitude

    def document(self, scales: Scales) -> dict[str, Any]:
        """It as data, for ``hapticd check --json``."""
        return {
            "beta_v": self.damper.beta_v,
            "gamma": self.damper.gamma,
            "grain": self.damper.grain,
            "passive": {"viscous_least": self.passive_least, "viscous": self.viscous, "holds": self.passive},
            "linearly_stable": self.linearly_stable,
            "exact": [
                {
                    "xi": run.xi,
                    "xi_dot": run.xi_dot,
                    "outcome": run.outcome,
                    "periods": run.periods,
                    "amplitude_ticks": run.amplitude,
                    "frequency_hz": scales.omega_to_hz(run.omega),
                }
                for run in self.runs
            ],
        }


def damped(
    config: Config, loop: Loop, xi_dot_max: float | None, deflection: float | None, velocity: float | None
) -> Damped:
    """Look at a loop with virtual damping.

    Args:
        config: with ``spring.damping`` above 0. loop: it in SI units; without a spring, one too soft to matter stands in.
        xi_dot_max: velocity bound of the motion, ticks per period; None without one.
        deflection, velocity: how the motion starts, in ticks and ticks per period; None for no motion.
    """
    if loop.stiffness == 0.0:
        loop = replace(loop, stiffness=_TOO_SOFT * loop.inertia / loop.period**2)
    damper, numbers, scales = damper_from_config(config, loop), loop.numbers, loop.scales
    if xi_dot_max is None:
        runs = tuple(exact_run(numbers, damper, xi_dot=speed) for speed in SPEEDS)
    else:
        runs = (exact_run(numbers, damper, deflection or 0.0, velocity or 0.0),)
    return Damped(
        damper=damper,
        passive_least=passive_beta(numbers, damper) * scales.stiffness * scales.period,
        viscous=loop.viscous,
        runs=runs,
        linearly_stable=is_linearly_stable(numbers, damper),
    )
