"""Probability of stability under the uncertainty of inertia, friction and delay (``plant.uncertainty``).

Every draw (`hapticd.stability.draws`) is judged like the config itself. The same config always gives the same result.
The torque constant is not drawn: μ, β and σ are ratios in which it cancels (`hapticd.identify.workflow`).

K_max at 95 % is the largest stiffness that is unstable in at most 5 % of the draws. For one device the margin has one change
of sign in K (`hapticd.stability.tuning`), so it is the 5 % quantile of the largest stiffnesses.

With virtual damping there are fewer draws, judged by proof or exploration, passivity by Colgate and Schenkel's bound or
λ, and no largest stiffness is given.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from hapticd.stability._damped import damped
from hapticd.stability.assessment import CALM, Assessment
from hapticd.stability.criterion import criterion_margin
from hapticd.stability.draws import PARAMETERS, deviations, moved, normals
from hapticd.stability.explore import DRAW, explore
from hapticd.stability.numbers import Loop
from hapticd.stability.regions import region
from hapticd.stability.theorems import holds
from hapticd.stability.tuning import Start, stiffness_max_dissipating, stiffness_max_passive

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

LEVEL: Final = 0.95
_LOG2_DRAWS: Final = 10
_LOG2_DRAWS_DAMPED: Final = 7
"""Each of them runs the exact loop."""
#: Regions in which a draw without a proof is explored.
_HOPEFUL: Final = CALM | {"F2"}
_LEAST_SHARE: Final = 0.02
"""Smallest share of the margin's variance with which a parameter is reported as decisive."""


@dataclass(frozen=True)
class Confidence:
    """Probabilities of an operating point.

    Attributes:
        stable: probability that the motion (any motion, if none was requested) dies out.
        passive: probability that no motion can gain energy, by proof.
        decides: the parameter with the largest influence on the margin; None if none has.
        shares: of the margin's variance that each parameter explains, with its correlated parameters.
        stiffness_max: largest K that is stable with a probability of `LEVEL`; None with virtual damping.
        beta, sigma: (n,) operating points of the draws.
    """

    stable: float
    passive: float
    decides: str | None
    shares: dict[str, float]
    stiffness_max: float | None
    beta: Floats
    sigma: Floats

    @property
    def document(self) -> dict[str, Any]:
        """The key ``probability`` of ``hapticd check``."""
        return {
            "stable": self.stable,
            "passive": self.passive,
            "decides": self.decides,
            "shares": self.shares,
            "stiffness_max_95": self.stiffness_max,
        }

    @property
    def text(self) -> str:
        """One or two sentences."""
        text = f"stable with a probability of {self._percent(self.stable)}, passive with {self._percent(self.passive)}"
        if self.decides is not None:
            what = {"viscous": "viscous friction", "coulomb": "Coulomb friction"}.get(self.decides, self.decides)
            text += f"; the {what} decides ({100 * self.shares[self.decides]:.0f} % of what is uncertain)"
        return text

    def _percent(self, probability: float) -> str:
        """A percentage, never exactly 0 or 100."""
        draws = self.beta.size
        if probability > 1.0 - 1.0 / draws:
            return f"more than {100.0 * (1.0 - 1.0 / draws):.1f} %"
        if probability < 1.0 / draws:
            return f"less than {100.0 / draws:.1f} %"
        return f"{100.0 * probability:.1f} %"


def confidence(found: Assessment) -> Confidence | None:
    """Probabilities for an assessed configuration and motion; None if its config has no uncertainty.

    Args:
        found: the assessment of the config itself.
    """
    uncertainty = found.config.plant.uncertainty
    if not uncertainty.is_known or found.loop.stiffness == 0.0:
        return None
    spread = deviations(uncertainty)
    normal = normals(uncertainty, _LOG2_DRAWS if found.damped is None else _LOG2_DRAWS_DAMPED)
    loops = [_moved(found, errors) for errors in normal * spread]
    judged = _of_spring(found, loops) if found.damped is None else _with_damping(found, loops)
    varying = spread > 0.0
    shares = {
        name: float(np.corrcoef(judged.margins, errors)[0, 1] ** 2) if vary and np.ptp(judged.margins) > 0.0 else 0.0
        for name, errors, vary in zip(PARAMETERS, normal.T, varying, strict=True)
    }
    first = max(shares, key=lambda name: shares[name])
    numbers = [loop.numbers for loop in loops]
    return Confidence(
        stable=float(np.mean(judged.stable)),
        passive=float(np.mean(judged.passive)),
        decides=first if shares[first] > _LEAST_SHARE else None,
        shares=shares,
        stiffness_max=judged.stiffness_max,
        beta=np.array([n.beta for n in numbers]),
        sigma=np.array([n.sigma for n in numbers]),
    )


class _Judged(NamedTuple):
    """The draws: which are stable, which passive, and the margin of each."""

    stable: NDArray[np.bool_]
    passive: NDArray[np.bool_]
    margins: Floats
    stiffness_max: float | None


def _of_spring(found: Assessment, loops: Sequence[Loop]) -> _Judged:
    """By the paper's regions and criterion."""
    start = found.start
    regions = [region(loop.numbers, None if start is None else start.xi_dot_max(loop)) for loop in loops]
    stable = np.array(
        [
            _holds(found, loop) or (where in _HOPEFUL and _rests(found, loop))
            for where, loop in zip(regions, loops, strict=True)
        ]
    )
    passive = np.array([holds(found.config, loop, None) for loop in loops])
    # a parameter can only decide a property that differs between draws
    of_passivity = _is_open(passive) and not _is_open(stable)
    bounds = [None if of_passivity or start is None else start.xi_dot_max(loop) for loop in loops]
    margins = np.array([criterion_margin(loop.numbers, bound) for loop, bound in zip(loops, bounds, strict=True)])
    largest = float(np.quantile([_largest(loop, start) for loop in loops], 1.0 - LEVEL, method="lower"))
    return _Judged(stable, passive, margins, largest)


def _with_damping(found: Assessment, loops: Sequence[Loop]) -> _Judged:
    """By the rules of `check`: proof or exploration, and Colgate and Schenkel's bound."""
    stable = np.array([_holds(found, loop) or _rests(found, loop) for loop in loops])
    passive = np.array([damped(found.config, loop).passive for loop in loops])
    open_answer = passive if _is_open(passive) and not _is_open(stable) else stable
    return _Judged(stable, passive, open_answer.astype(float), None)


def _moved(found: Assessment, errors: Floats) -> Loop:
    """The loop of one draw. The parts of the hand and of effects are not changed."""
    loop, plant = found.loop, found.config.plant
    inertia, viscous, coulomb, delay = errors.tolist()

    return replace(
        loop,
        inertia=loop.inertia - plant.inertia + moved(plant.inertia, inertia),
        viscous=loop.viscous - plant.viscous + moved(plant.viscous, viscous),
        coulomb=max(loop.coulomb - plant.coulomb + moved(plant.coulomb, coulomb), 0.0),
        delay=max(loop.delay + delay, 0.0),
    )


def _is_open(answers: NDArray[np.bool_]) -> bool:
    return bool(answers.any() and not answers.all())


def _holds(found: Assessment, loop: Loop) -> bool:
    return holds(found.config, loop, None if found.start is None else found.start.xi_dot_max(loop))


def _rests(found: Assessment, loop: Loop) -> bool:
    """Whether all of a few starts come to rest."""
    motion = None if found.start is None else found.start.to_ticks(loop)
    return explore(found.config, loop=loop, motion=motion, effort=DRAW).stable


def _largest(loop: Loop, start: Start | None) -> float:
    """Largest K of one draw: for the motion, or, without one, for every motion."""
    return stiffness_max_passive(loop) if start is None else stiffness_max_dissipating(loop, start)
