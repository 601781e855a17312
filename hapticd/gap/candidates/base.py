"""Errors of the four base parameters, each an edit of one key of the model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hapticd.gap.candidates.build import Scalar, scalar_term

if TYPE_CHECKING:
    from hapticd.gap.context import Context
    from hapticd.gap.hypothesis import Term


def inertia_error(context: Context) -> list[Term]:
    """J → J(1 + r)."""
    return [scalar_term("inertia_error", Scalar("r", 0.0, -0.8, 4.0))]


def viscous_friction(context: Context) -> list[Term]:
    """b → b(1 + r); a model without viscous friction has none to correct."""
    return [scalar_term("viscous_friction", Scalar("r", 0.0, -1.0, 20.0))] if context.viscous > 0.0 else []


def coulomb_friction(context: Context) -> list[Term]:
    """c → c(1 + r); a model without Coulomb friction has none to correct."""
    return [scalar_term("coulomb_friction", Scalar("r", 0.0, -1.0, 5.0))] if context.coulomb > 0.0 else []


def torque_constant_error(context: Context) -> list[Term]:
    """K_t → K_t(1 + r)."""
    return [scalar_term("torque_constant_error", Scalar("r", 0.0, -0.8, 4.0))] if context.peak_current > 0.0 else []
