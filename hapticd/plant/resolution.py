"""How finely a device's tick has to be divided for its effects."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hapticd.config.effect_parameters import RIPPLE_ORDERS
from hapticd.plant.coupled import is_underdamped
from hapticd.plant.effects.layout import word
from hapticd.plant.laws import has_bristle

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_SUBSTEPS = 64
"""Substeps a tick is divided into at most: what is faster than that is no concern of the loop's rate."""

_PHASE_OF_FIELD = 0.5
"""Largest angle [rad] of a swing in a position-dependent torque during a substep."""
_PHASE_OF_COUPLING = 0.35
"""Largest angle [rad] of the two masses' oscillation during a substep, where it is not exact (`hapticd.plant.coupled`)."""
_PHASE_OF_LAG = 1.0
_STRIBECK_PART = 0.5
"""Largest change of speed during a substep on a bristle, in units of omega_s, at an acceleration of four times the friction;
where there is stiction, `hapticd.plant.slide` divides what needs it."""


def substeps_for(p: NDArray[np.float64], period_s: float) -> int:
    """Substeps a tick for which `mechanical` and `electrical` are accurate with a device's effects.

    Without effects, and with those that are exact, it is 1. Stops, impacts, the bristle of `presliding` and the friction of
    `stribeck` are resolved inside a substep and need none. The limits here leave errors of the order of 10⁻³ of the effect
    (tests/plant/effects).

    Args:
        p: device vector, shape (SIZE,).
        period_s: duration of a tick [s].
    """

    def of(name: str) -> float:
        return float(p[word(name)])

    inertia = of("inertia") * (1.0 + of("inertia_error.r"))
    if of("flexible_coupling.f_r") < math.inf:
        inertia *= 1.0 - of("flexible_coupling.load_share")
    if of("backlash.gap") > 0.0:
        inertia *= 1.0 - of("backlash.load_share")
    inertia += of("grip_inertia")
    parts = [1.0]
    if of("stribeck.s") > 0.0 and has_bristle(p):
        friction = of("coulomb") * (1.0 + of("coulomb_friction.r"))
        parts.append(4.0 * friction / inertia * period_s / (_STRIBECK_PART * of("stribeck.omega_s")))
    orders, amplitudes = word("torque_ripple.orders"), word("torque_ripple.amplitudes")
    stiffness = float(p[orders : orders + RIPPLE_ORDERS] @ p[amplitudes : amplitudes + RIPPLE_ORDERS])
    stiffness += of("gravity.m_g_l")
    parts.append(math.sqrt(stiffness / inertia) * period_s / _PHASE_OF_FIELD)
    if of("flexible_coupling.f_r") < math.inf:
        share = of("flexible_coupling.load_share")
        if has_bristle(p) or not is_underdamped(share / (1.0 - share), of("flexible_coupling.damping")):
            natural = 2.0 * math.pi * of("flexible_coupling.f_r") / math.sqrt(1.0 - share)
            parts.append(natural * period_s / _PHASE_OF_COUPLING)
    if of("amplifier_lag.f_a") < math.inf:
        parts.append(min(2.0 * math.pi * of("amplifier_lag.f_a") * period_s / _PHASE_OF_LAG, 8.0))
    return int(min(math.ceil(max(parts)), MOST_SUBSTEPS))
