"""Effects that change the friction: direction, speed, load, displacement, time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.candidates.build import Scalar, scalar_term

if TYPE_CHECKING:
    from hapticd.gap.context import Context
    from hapticd.gap.hypothesis import Term


def asymmetric_coulomb(context: Context) -> list[Term]:
    """c± = c(1 ± a)."""
    return [scalar_term("asymmetric_coulomb", Scalar("a", 0.0, -1.0, 1.0))] if context.coulomb > 0.0 else []


def asymmetric_viscous(context: Context) -> list[Term]:
    """b± = b(1 ± a)."""
    return [scalar_term("asymmetric_viscous", Scalar("a", 0.0, -1.0, 1.0))] if context.viscous > 0.0 else []


def stribeck(context: Context) -> list[Term]:
    """c → c(1 + s·exp(−(ω/ω_s)²)), ω_s between what a window can resolve and what the recording reaches.

    A larger ω_s would be a larger Coulomb friction, a smaller one nothing at all.
    """
    if context.coulomb <= 0.0:
        return []
    # Friction alone takes a shaft through a smaller ω_s before the encoder notices.
    braked = context.coulomb / context.inertia * context.window_s
    low, high = max(context.slowest_speed, 0.03 * braked), 0.7 * context.top_speed
    if high <= low:
        return []
    starts = np.geomspace(1.5 * low, 0.7 * high, 3)
    return [
        scalar_term("stribeck", Scalar("s", 0.1, 0.0, 10.0), Scalar("omega_s", float(w), low, high, True))
        for w in starts
    ]


def presliding(context: Context) -> list[Term]:
    """LuGre bristles; a breakaway displacement far below the resolution is plain stiction."""
    if context.coulomb <= 0.0:
        return []
    low, high = 0.5 * context.resolution, max(0.3 * context.span, context.resolution)
    starts = [s for s in np.array([3.0, 15.0, 75.0]) * context.resolution if low < s < high]
    terms = []
    for breakaway in starts:
        critical = 2.0 * np.sqrt(context.inertia * context.coulomb / breakaway)
        terms.append(
            scalar_term(
                "presliding",
                Scalar("breakaway", float(breakaway), low, high, True),
                Scalar("sigma_1", 0.3 * critical, 1e-3 * critical, 10.0 * critical, True),
            )
        )
    return terms


def quadratic_drag(context: Context) -> list[Term]:
    """−d·ω|ω|, at most a few times the friction at the top speed."""
    limit = 10.0 * context.force_scale / context.top_speed**2
    return [scalar_term("quadratic_drag", Scalar("d", 0.0, -limit, limit))]


def load_dependent_friction(context: Context) -> list[Term]:
    """c → c + κ·|K_t·i|."""
    return (
        [scalar_term("load_dependent_friction", Scalar("kappa", 0.0, 0.0, 1.0))] if context.peak_current > 0.0 else []
    )


def thermal_drift(context: Context) -> list[Term]:
    """c changes as 1 + r·(1 − exp(−t/t_w)), with a t_w that this recording can see: a shorter one is another c."""
    if context.coulomb <= 0.0:
        return []
    low, high = 0.1 * context.duration, 2.0 * context.duration
    return [
        scalar_term(
            "thermal_drift", Scalar("r", 0.0, -1.0, 10.0), Scalar("t_w", share * context.duration, low, high, True)
        )
        for share in (0.15, 0.5)
    ]
