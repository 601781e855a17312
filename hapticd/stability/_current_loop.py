"""The amplifier's current loop, i″ = ω²(u − i) − 2δω i′: its parameters in a configuration, its cost in the theorems.

Regions and criterion take it as the delay T_A = 2δ/ω of (5); proofs and exploration use the second order.
"""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING

import numpy as np

from hapticd.effects import amplifier_lag
from hapticd.stability.criterion import lambda_

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.stability.numbers import Loop

#: Points of the impulse response, and the factor by which the result is rounded up.
_POINTS, _ROUNDING = 20_000, 1.0 + 1e-3


def current_loop(config: Config, loop: Loop) -> tuple[float, float, float]:
    """The second-order current loop that is part of a loop's delay: the effect ``amplifier_lag``, else the amplifier.

    Args:
        config: the configuration. loop: the same in SI units, or another loop of the same kind.

    Returns:
        The remaining delay before it (periods), ω (rad per period) and δ; both 0 if there is none.
    """
    hertz, ratio = config.amplifier.bandwidth_hz, config.amplifier.damping_ratio
    for listed in config.plant.effects:
        if listed.name == amplifier_lag.EFFECT.slug:
            values = amplifier_lag.EFFECT.complete(listed.model_extra or {})
            hertz, ratio = float(values["f_a"]), float(values["delta"])
    if not hertz:
        return loop.delay / loop.period, 0.0, 0.0
    own = ratio / (math.pi * hertz)
    # rounding must not move a delay of whole periods below that number
    return round(max(0.0, loop.delay - own) / loop.period, 12), 2.0 * math.pi * hertz * loop.period, ratio


@functools.lru_cache(maxsize=256)
def lagged(tau: float, natural: float, damping: float, beta_v: float = 0.0) -> tuple[float, float, float]:
    """λ, the gain of q and the lateness of the first force, for a second-order current loop behind a delay.

    Its force is a sum of delayed forces, weighted with its impulse response a(θ): each delay τ + θ generates at most
    λ(τ + θ)∫ξ̇², for either sign of its weight.

    Args:
        tau: the delay before it, periods. natural: ω_A, rad per period. damping: δ_A. beta_v: virtual damping.

    Returns:
        ∫|a|λ(τ + θ)dθ, ∫|a|dθ and ∫|1 − s|dθ with the step response s, rounded up by 10⁻³.
    """
    slowest = damping if damping <= 1.0 else 1.0 / (damping + math.sqrt(damping * damping - 1.0))
    step = 25.0 / slowest / _POINTS
    x = step * (np.arange(_POINTS) + 0.5)
    root = np.sqrt(complex(damping * damping - 1.0))
    if abs(root) < 1e-6:
        root = 1e-6 + 0.0j  # critical damping, to 12 digits
    fast, slow = damping + root, damping - root
    impulse = ((np.exp(-slow * x) - np.exp(-fast * x)) / (2.0 * root)).real
    rest = ((fast * np.exp(-slow * x) - slow * np.exp(-fast * x)) / (2.0 * root)).real
    weight = np.abs(impulse) * step * _ROUNDING
    lam = float(weight @ lambda_(tau + x / natural, beta_v))
    return lam, float(weight.sum()), float(np.abs(rest).sum() * step / natural) * _ROUNDING
