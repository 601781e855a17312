"""Number of substeps of a tick for a device's effects."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.plant.coupled import is_underdamped
from hapticd.plant.effect_terms import STEADY_PART, coulomb_level, has_bristle, speed_scale, whole_inertia
from hapticd.plant.layout import effect_values, index_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_SUBSTEPS = 64
"""Most substeps of a tick: faster dynamics are not resolved."""

_PHASE_OF_FIELD = 0.5
"""Largest angle [rad] of the oscillation in a position-dependent torque during a substep."""
_PHASE_OF_COUPLING = 0.35
"""Largest angle [rad] of the two masses' oscillation during a substep, if it is not exact (`hapticd.plant.coupled`)."""
_PHASE_OF_LAG = 1.0
_PART_OF_DECAY = 0.5
"""Largest substep as a fraction of the time constant of a law that depends on speed."""
_HARDEST_PULL = 4.0
"""Acceleration, in units of the friction's, at which a substep on a bristle still resolves a friction that changes with
speed; with stiction, `hapticd.plant._slide` divides the step."""

_STIFF = tuple(effect for effect in CATALOGUE.values() if effect.stiffness is not None)
_DAMPING = tuple(effect for effect in CATALOGUE.values() if effect.damping is not None)


def substeps_for(p: NDArray[np.float64], period_s: float) -> int:
    """Substeps per tick with which `mechanical` and `electrical` are accurate for a device's effects.

    Without effects, and with exact ones, it is 1. Stops, impacts, the bristle of `presliding` and a friction that
    changes with speed are resolved inside a substep and need none. With these limits the errors are of the order of 10⁻³ of
    the effect (tests/plant/effects).

    Args:
        p: device vector, shape (SIZE,).
        period_s: duration of a tick [s].
    """

    def of(name: str) -> float:
        return float(p[index_of(name)])

    inertia = float(whole_inertia(p))
    if of("flexible_coupling.f_r") < math.inf:
        inertia *= 1.0 - of("flexible_coupling.load_share")
    if of("backlash.gap") > 0.0:
        inertia *= 1.0 - of("backlash.load_share")
    inertia += of("grip_inertia")
    parts = [1.0]
    if has_bristle(p):
        parts.append(_HARDEST_PULL * coulomb_level(p) / inertia * period_s / (STEADY_PART * speed_scale(p)))
    stiffness = sum(effect.stiffness(effect_values(p, effect)) for effect in _STIFF if effect.stiffness)
    parts.append(math.sqrt(stiffness / inertia) * period_s / _PHASE_OF_FIELD)
    damping = sum(effect.damping(effect_values(p, effect)) for effect in _DAMPING if effect.damping)
    parts.append(damping / inertia * period_s / _PART_OF_DECAY)
    if of("flexible_coupling.f_r") < math.inf:
        fraction = of("flexible_coupling.load_share")
        if has_bristle(p) or not is_underdamped(fraction / (1.0 - fraction), of("flexible_coupling.damping")):
            natural = 2.0 * math.pi * of("flexible_coupling.f_r") / math.sqrt(1.0 - fraction)
            parts.append(natural * period_s / _PHASE_OF_COUPLING)
    if of("amplifier_lag.f_a") < math.inf:
        parts.append(min(2.0 * math.pi * of("amplifier_lag.f_a") * period_s / _PHASE_OF_LAG, 8.0))
    return int(min(math.ceil(max(parts)), MOST_SUBSTEPS))
