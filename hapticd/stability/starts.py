"""The starts from which a loop is explored: spread evenly over energy, place, memory and phase, the same in every run."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.stability.storage import FloatArray
from hapticd.stability.whole_loop import LIMIT

#: Amplitude of the slightest start, ticks.
_SMALLEST: Final = 0.2
#: From how little of a kick, and by what factor to how much.
_SPREAD: Final = (0.03, 100.0)
HEAVIEST: Final = 1e6
"""μ beyond which energy is no measure of a place."""


def horizon(loop: NDArray[Any], reach: float, most: int) -> int:
    """Periods in which friction alone brings the fastest start to rest, several times."""
    mu, beta, sigma = (float(loop[name][0]) for name in ("mu", "beta", "sigma"))
    speed = reach / math.sqrt(min(mu, HEAVIEST))
    by_coulomb = speed * mu / sigma if sigma > 0.0 else math.inf
    late = float(loop["tau_d"][0]) + 2.0 * float(loop["ratio"][0]) / (float(loop["natural"][0]) or 1.0)
    net = beta + float(loop["beta_v"][0]) - 0.5 - late
    by_viscous = 20.0 * mu / net if net > 0.0 else math.inf
    return int(min(max(20_000.0, 3.0 * min(by_coulomb, by_viscous)), most))


def _window(loop: NDArray[Any]) -> int:
    """First window of a search: some time constants of the friction."""
    mu, beta = float(loop["mu"][0]), float(loop["beta"][0])
    return int(min(max(256.0, 4.0 * mu / beta if beta > 0.0 else math.inf), 4096.0))


def _kick(loop: NDArray[Any]) -> float:
    """Speed that the damper's answer to one tick gives a mass that stands beside an edge, whatever friction leaves of it.

    A cycle about an edge that this answer drives is that small, and so is what leads into it.
    """
    force = float(loop["beta_v"][0]) * (1.0 - float(loop["keep"][0])) / float(loop["periods"][0])
    return abs(force + 0.5 - float(loop["sigma"][0])) / min(float(loop["mu"][0]), HEAVIEST)


#: Powers of the plastic number's like in six dimensions (M. Roberts): no two starts are near each other in any of them.
_ROOT: Final = 1.1347241384015194
_DIMENSIONS: Final = np.array([_ROOT ** -(k + 1) for k in range(5)])


def starts_of(
    loop: NDArray[Any], motion: tuple[float, float] | None, reach: float, widest: float, first: int, count: int
) -> NDArray[Any]:
    """Starts ``first`` … of a loop, (count,) of `LOOP`; number 0 is the motion, if there is one."""
    number = np.arange(first, first + count)
    kind, size, angle, memory, phase = ((0.5 + (number[:, None] + 1) * _DIMENSIONS) % 1.0).T
    mu, sigma, kappa = (float(loop[name][0]) for name in ("mu", "sigma", "kappa"))
    weight = math.sqrt(min(mu, HEAVIEST))
    low = min(_SMALLEST, 0.25 * reach)
    far = np.where(number % 2 == 0, low * (reach / max(low, 1e-300)) ** size, low + (reach - low) * size)
    turn = 2.0 * np.pi * angle
    x, v = far * np.cos(turn) / math.sqrt(1.0 + kappa), far * np.sin(turn) / weight
    # a release, a passage through the origin, a touch beside one of the places where the mass can stand
    side = np.where(angle < 0.5, -1.0, 1.0)
    released, passing, touched = kind < 0.2, (kind >= 0.2) & (kind < 0.35), (kind >= 0.35) & (kind < 0.5)
    x = np.where(released, side * far / math.sqrt(1.0 + kappa), np.where(passing, 0.0, x))
    v = np.where(released, 0.0, np.where(passing, side * far / weight, v))
    stands = min(sigma + 3.0, reach)
    x = np.where(touched, stands * (2.0 * (memory * 7.0 % 1.0) - 1.0), x)
    v = np.where(touched, side * low * (max(reach, low) / max(low, 1e-300)) ** (0.5 * size) / weight, v)
    # where there is a damper, its kicks at an edge: most at the origin's, some at others where the mass can stand
    kicked = (kind >= 0.5) & (kind < 0.65) & (float(loop["beta_v"][0]) > 0.0)
    kick = min(_kick(loop), reach / weight)
    kick = kick * _SPREAD[0] * _SPREAD[1] ** size
    edge = np.where(angle < 0.75, 0.0, np.rint(stands * (2.0 * (size * 7.0 % 1.0) - 1.0)))
    x = np.where(kicked, edge + kick * (2.0 * phase - 1.0), x)
    v = np.where(kicked, kick * (2.0 * (angle * 16.0 % 1.0) - 1.0), v)
    less = reach / np.maximum(np.hypot(x * math.sqrt(1.0 + kappa), v * weight), max(reach, 1e-300))
    x, v = np.clip(x * less, -widest, widest), v * less
    known, past = ~released & ~passing & (kicked | (memory < 0.6)), np.where(memory < 0.4, v, 0.0)
    if motion is not None and first == 0:  # as `simulate` has it: the servo remembers nothing
        (x[0], v[0]), known[0], past[0], phase[0] = motion, False, 0.0, loop["phase"][0]
    begun = alone(loop, x, v)
    begun["known"], begun["past"] = known, past
    begun["phase"], begun["seed"] = phase, loop["seed"][0] + number
    return begun


def alone(loop: NDArray[Any], xi: FloatArray, xi_dot: FloatArray) -> NDArray[Any]:
    """Starts as ``simulate`` has them: the servo remembers nothing; (n,) of `LOOP` for (n,) places and speeds."""
    begun = np.repeat(loop, xi.size)
    begun["xi"], begun["xi_dot"] = xi, xi_dot
    weight = math.sqrt(min(float(loop["mu"][0]), HEAVIEST))
    begun["far"] = np.minimum(LIMIT, 1e3 * (10.0 + np.abs(xi) + weight * np.abs(xi_dot)))
    begun["search"] = _window(loop)
    return begun
