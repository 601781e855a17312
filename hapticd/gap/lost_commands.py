"""Lost commands beyond the filter's normal distribution.

The filter takes a command that may be lost as a normal force of the same variance. That cannot tell lost commands from a
model that is less exact where the command changes much. But a lost command is one of two forces, and no other: each tick's
force, as the samples tell it, is compared with these two.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from hapticd.gap.kernel.linear import smoothed
from hapticd.gap.missing import white_variance
from hapticd.plant.effect_terms import torque_constant
from hapticd.plant.layout import index_of

if TYPE_CHECKING:
    from hapticd.gap.arrays import Floats
    from hapticd.gap.fit import Fit

_LOSS: Final = index_of("dropped_samples.p")
_WHITES: Final = 9
"""Values of the white noise that are tried, up to the variance of the lost commands."""
_LEAST: Final = 1e-6
"""Least share of the variance of a tick's force that is not of lost commands; keeps rounding positive."""


def mixture_gain(fit: Fit) -> Floats:
    """Log-likelihood of each tick's force if its command was kept or lost, less that of the normal force, nats.

    Given all samples, the force w of a tick has the likelihood N(m, V). With q the white noise, it is N(0, q + σ²) in the
    filter; a command that is kept or lost makes it N(p Δ, q) with probability 1 − p and N(−(1 − p) Δ, q + s²) with p, where
    Δ is the change of the torque and s that of the command that stays. The other ticks keep their normal forces.

    Args:
        fit: a fit with the law ``dropped_samples``; others have 0 everywhere.

    Returns:
        Shape (n,).
    """
    loss = float(fit.device()[_LOSS])
    if loss == 0.0:
        return np.zeros(fit.out.size)
    duration, current, spread = fit.currents()
    part = int(np.argmax(duration.sum(axis=0)))  # a delay divides a period between two commands: the longer one
    torque = torque_constant(fit.device()) * duration[:, part] / duration.sum(axis=1)
    change = torque * np.diff(current[:, part], prepend=current[0, part]) / (1.0 - loss)
    change[fit.problem.series.begins] = 0.0
    variance = (torque * spread[:, part]) ** 2
    stays = np.maximum(variance - loss * (1.0 - loss) * change**2, 0.0) / loss
    prior = white_variance(fit)
    found = smoothed(fit.out, prior)
    seen = found[:, 4] > 0.0
    whole = np.divide(1.0, found[:, 4], out=np.ones(seen.size), where=seen)  # V + q + σ²
    force = found[:, 3] / prior * whole
    rest = np.maximum(whole - variance, _LEAST * whole)

    def normal(away: Floats, spread: Floats) -> Floats:
        return np.asarray(-0.5 * (away**2 / spread + np.log(spread)))

    def gain(white: float) -> Floats:
        kept = np.log1p(-loss) + normal(force - loss * change, rest + white)
        lost = np.log(loss) + normal(force + (1.0 - loss) * change, rest + white + stays)
        return np.where(seen, np.logaddexp(kept, lost) - normal(force, whole), 0.0)

    # The noise was fitted beside the normal force, which takes up other errors as well.
    whites = float(np.mean(variance)) * np.concatenate([[0.0], np.logspace(-4.0, 0.0, _WHITES)])
    return max((gain(float(white)) for white in whites), key=lambda ticks: float(ticks.sum()))
