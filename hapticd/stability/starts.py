"""The starts from which a loop is explored: spread evenly over energy, place, memory and phase, the same in every run."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.stability.whole_loop import LIMIT

#: Amplitude of the slightest start, ticks.
_SMALLEST: Final = 0.2
HEAVIEST: Final = 1e6
"""μ beyond which energy is no measure of a place."""


def horizon(loop: NDArray[Any], reach: float, most: int) -> int:
    """Periods in which friction alone brings the fastest start to rest, several times."""
    mu, beta, sigma = (float(loop[name][0]) for name in ("mu", "beta", "sigma"))
    speed = reach / math.sqrt(min(mu, HEAVIEST))
    by_coulomb = speed * mu / sigma if sigma > 0.0 else math.inf
    net = beta + float(loop["beta_v"][0]) - 0.5 - float(loop["tau_d"][0])
    by_viscous = 20.0 * mu / net if net > 0.0 else math.inf
    return int(min(max(20_000.0, 3.0 * min(by_coulomb, by_viscous)), most))


def _window(loop: NDArray[Any]) -> int:
    """First window of a search: some time constants of the friction."""
    mu, beta = float(loop["mu"][0]), float(loop["beta"][0])
    return int(min(max(256.0, 4.0 * mu / beta if beta > 0.0 else math.inf), 4096.0))


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
    x, past = np.clip(x, -widest, widest), np.where(memory < 0.4, v, 0.0)
    known = ~released & ~passing & (memory < 0.6)
    if motion is not None and first == 0:  # as `simulate` has it: the servo remembers nothing
        (x[0], v[0]), known[0], past[0], phase[0] = motion, False, 0.0, loop["phase"][0]
    begun = np.repeat(loop, count)
    begun["xi"], begun["xi_dot"], begun["known"], begun["past"] = x, v, known, past
    begun["phase"], begun["seed"] = phase, loop["seed"][0] + number
    begun["far"] = np.minimum(LIMIT, 1e3 * (10.0 + np.abs(x) + weight * np.abs(v)))
    begun["search"] = _window(loop)
    return begun
