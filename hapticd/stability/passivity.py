"""Time-domain passivity of the rendered spring: what the observer books in a period, what the controller does about it.

**Observer** (B. Hannaford, J.-H. Ryu, IEEE Trans. Robotics and Automation 18, 2002). Between two samples the current sent
is held, so the work that it does on the device is exactly its torque times the way between the counts read. A spring that
is what it seems gives no more than it had stored:

    G(k) = G(k−1) + F(k−1) (x(k) − x(k−1)) + V(x(k)) − V(x(k−1)),

V being the potential of (34). V is the reference energy that the output has to follow (J.-H. Ryu, C. Preusche, B. Hannaford,
G. Hirzinger, IEEE Trans. Control Systems Technology 13, 2005): what the spring stored and has not given yet is no licence
to generate. G is the energy that sampling, ticks and delay generate, less what virtual damping takes out.

**Controller.** What is generated has to be dissipated again: E(k) = max(0, E(k−1) + ΔG(k)), so that nothing dissipated
earlier is a licence either. On the way Δx(k) of the last period, damping that is held for the next one takes E out with

    F = −min(E/Δx², α T) Δx,      αT = 2 b_p,      b_p = KT λ(τ_D, β_v).

Without a bound the damping would be largest where the way is one count and says least; twice what passivity asks of the
device (`hapticd.stability.damping`) is enough to work off more than any period generates. What the bound or the peak
current leaves over stays in E. A way of no count shows nothing and is answered with nothing.

Positions are those of the raw counts, each at its middle: inside one count the observer is blind.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import types

from hapticd.jit import njit

_f8 = types.float64

#: ``spring.side`` → what `spring_potential` takes for it.
SIDES: Final = {"both": 0.0, "positive": 1.0, "negative": -1.0}


@njit(_f8(_f8, _f8, _f8), inline=True)
def spring_potential(xi: float, bias: float, side: float) -> float:
    """Potential of the rendered spring at ξ ticks in KΔ²: (34), for a wall or without the half-tick bias its like.

    Args:
        xi: position. bias: ½, or 0 without the half tick. side: of `SIDES`.
    """
    if xi * side < 0.0:
        return 0.0
    n = np.floor(xi)
    return float(0.5 * n * (n - 1.0) + n * (xi - n) + bias * xi)


@njit(_f8(_f8, _f8, _f8), inline=True)
def dissipating_force(excess: float, moved: float, stiffest: float) -> float:
    """Force that dissipates the energy ``excess`` on a way like the last one, ``moved``.

    Args:
        excess: E. moved: Δx, not zero. stiffest: largest force for a unit of way, αT. Consistent units.
    """
    return -min(excess / (moved * moved), stiffest) * moved
