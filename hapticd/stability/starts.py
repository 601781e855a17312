"""The starts of an exploration: spread evenly over energy, position, memory and phase, the same in every run."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.stability.storage import FloatArray
from hapticd.stability.whole_loop import LIMIT

#: Amplitude of the smallest start, ticks.
_SMALLEST: Final = 0.2
#: Smallest start as a fraction of `_kick`, and the factor from it to the largest.
_SPREAD: Final = (0.03, 100.0)
HEAVIEST: Final = 1e6
"""μ above which the energy does not determine a position."""


def horizon(loop: NDArray[Any], reach: float, most: int) -> int:
    """Periods: several times the time in which friction alone brings the fastest start to rest."""
    mu, beta, sigma = (float(loop[name][0]) for name in ("mu", "beta", "sigma"))
    speed = reach / math.sqrt(min(mu, HEAVIEST))
    by_coulomb = speed * mu / sigma if sigma > 0.0 else math.inf
    late = float(loop["tau_d"][0]) + 2.0 * float(loop["ratio"][0]) / (float(loop["natural"][0]) or 1.0)
    net = beta + float(loop["beta_v"][0]) - 0.5 - late
    by_viscous = 20.0 * mu / net if net > 0.0 else math.inf
    return int(min(max(20_000.0, 3.0 * min(by_coulomb, by_viscous)), most))


def _window(loop: NDArray[Any]) -> int:
    """First window of a search, in periods: several time constants of the friction."""
    mu, beta = float(loop["mu"][0]), float(loop["beta"][0])
    return int(min(max(256.0, 4.0 * mu / beta if beta > 0.0 else math.inf), 4096.0))


def _kick(loop: NDArray[Any]) -> float:
    """Speed that the damper's response to one tick gives to a mass at rest next to an encoder edge, without friction.

    Cycles about an edge that this response drives have this speed, and so do the motions that lead into them.
    """
    force = float(loop["beta_v"][0]) * (1.0 - float(loop["keep"][0])) / float(loop["periods"][0])
    return abs(force + 0.5 - float(loop["sigma"][0])) / min(float(loop["mu"][0]), HEAVIEST)


#: Generalised golden ratio of five dimensions (M. Roberts), for a low-discrepancy sequence.
_ROOT: Final = 1.1347241384015194
_DIMENSIONS: Final = np.array([_ROOT ** -(k + 1) for k in range(5)])


def starts_of(
    loop: NDArray[Any], motion: tuple[float, float] | None, reach: float, widest: float, first: int, count: int
) -> NDArray[Any]:
    """Starts of a loop from number ``first`` on, (count,) of `LOOP`; number 0 is the motion, if there is one."""
    number = np.arange(first, first + count)
    kind, size, angle, memory, phase = ((0.5 + (number[:, None] + 1) * _DIMENSIONS) % 1.0).T
    mu, sigma, kappa = (float(loop[name][0]) for name in ("mu", "sigma", "kappa"))
    weight = math.sqrt(min(mu, HEAVIEST))
    low = min(_SMALLEST, 0.25 * reach)
    far = np.where(number % 2 == 0, low * (reach / max(low, 1e-300)) ** size, low + (reach - low) * size)
    turn = 2.0 * np.pi * angle
    x, v = far * np.cos(turn) / math.sqrt(1.0 + kappa), far * np.sin(turn) / weight
    # a release, a passage through the origin, a small motion near one of the positions where the mass can rest
    side = np.where(angle < 0.5, -1.0, 1.0)
    released, passing, touched = kind < 0.2, (kind >= 0.2) & (kind < 0.35), (kind >= 0.35) & (kind < 0.5)
    x = np.where(released, side * far / math.sqrt(1.0 + kappa), np.where(passing, 0.0, x))
    v = np.where(released, 0.0, np.where(passing, side * far / weight, v))
    stands = min(sigma + 3.0, reach)
    x = np.where(touched, stands * (2.0 * (memory * 7.0 % 1.0) - 1.0), x)
    v = np.where(touched, side * low * (max(reach, low) / max(low, 1e-300)) ** (0.5 * size) / weight, v)
    # with a damper, its response at an encoder edge: most at the origin, some at others where the mass can rest
    kicked = (kind >= 0.5) & (kind < 0.65) & (float(loop["beta_v"][0]) > 0.0)
    kick = min(_kick(loop), reach / weight)
    kick = kick * _SPREAD[0] * _SPREAD[1] ** size
    edge = np.where(angle < 0.75, 0.0, np.rint(stands * (2.0 * (size * 7.0 % 1.0) - 1.0)))
    x = np.where(kicked, edge + kick * (2.0 * phase - 1.0), x)
    v = np.where(kicked, kick * (2.0 * (angle * 16.0 % 1.0) - 1.0), v)
    less = reach / np.maximum(np.hypot(x * math.sqrt(1.0 + kappa), v * weight), max(reach, 1e-300))
    x, v = np.clip(x * less, -widest, widest), v * less
    known, past = ~released & ~passing & (kicked | (memory < 0.6)), np.where(memory < 0.4, v, 0.0)
    if motion is not None and first == 0:  # as in `simulate`: the servo's memory is empty
        (x[0], v[0]), known[0], past[0], phase[0] = motion, False, 0.0, loop["phase"][0]
    begun = alone(loop, x, v)
    begun["known"], begun["past"] = known, past
    begun["phase"], begun["seed"] = phase, loop["seed"][0] + number
    return begun


def alone(loop: NDArray[Any], xi: FloatArray, xi_dot: FloatArray) -> NDArray[Any]:
    """Starts as in ``simulate``, with an empty servo memory; (n,) of `LOOP` for (n,) positions and velocities."""
    begun = np.repeat(loop, xi.size)
    begun["xi"], begun["xi_dot"] = xi, xi_dot
    weight = math.sqrt(min(float(loop["mu"][0]), HEAVIEST))
    begun["far"] = np.minimum(LIMIT, 1e3 * (10.0 + np.abs(xi) + weight * np.abs(xi_dot)))
    begun["search"] = _window(loop)
    return begun
