"""The (β, σ) plane with its regions, for Fig. 3, 5 and the left half of Fig. 8."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final

import numpy as np

from hapticd.figures.plane import middles, shade_regions
from hapticd.figures.style import INK, RED
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.regions import critical_sigma, region
from hapticd.stability.storage import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Line = Callable[[float, float, float, FloatArray], FloatArray]
"""μ, τ_D, ξ̇_max and (n,) β → (n,) σ."""
Name = Callable[[Dimensionless, float], str]
"""Operating point and ξ̇_max → region."""
_POINTS: Final = 200
_LABEL_GRID: Final = 72
# least share of the plane that a region needs for its name
_LEAST_SHARE: Final = 0.012


def critical_line(mu: float, tau_d: float, xi_dot_max: float, beta: FloatArray) -> FloatArray:
    """(n,) σ of the critical line, (12) or, with delay, theorem 2, at each β."""
    return critical_sigma(Dimensionless(mu, 0.0, 0.0, tau_d), xi_dot_max, beta)


def draw_plane(
    axes: Axes,
    mu: float,
    tau_d: float,
    xi_dot_max: float,
    beta_max: float,
    sigma_max: float,
    names: Mapping[str, str] | None = None,
    line: Line = critical_line,
    name: Name = region,
) -> dict[str, tuple[float, float]]:
    """Draw the regions of one velocity bound with their borders and names.

    Args:
        axes: to draw on.
        mu: inertia μ; used with delay only.
        tau_d: delay τ_D.
        xi_dot_max: velocity bound in ticks per period.
        beta_max: right end of the plane.
        sigma_max: upper end.
        names: text for each region; by default its letter.
        line, name: functions for the critical line and for the region of a point; by default ours.

    Returns:
        region → (β, σ) of a point in its middle.
    """
    corner = 0.5 + tau_d
    left, right = np.linspace(0.0, corner, _POINTS), np.linspace(corner, beta_max, _POINTS)
    whole, height = np.append(left, right[1:]), np.array([0.0, sigma_max])
    shade_regions(axes, whole, height, corner, 0.5, lambda beta: line(mu, tau_d, xi_dot_max, beta))
    axes.plot([corner, corner], [0.0, sigma_max], color=INK, lw=0.9)
    axes.plot([0.0, beta_max], [0.5, 0.5], color=INK, lw=0.9)
    axes.plot(left, line(mu, tau_d, xi_dot_max, left), color=RED, lw=1.8)
    if tau_d > 0.0:
        axes.plot(right, line(mu, tau_d, xi_dot_max, right), color=RED, lw=1.8, ls="--")
    axes.set_xlim(0.0, beta_max)
    axes.set_ylim(0.0, sigma_max)
    axes.set_xlabel(r"viscous friction $\beta$")
    axes.set_ylabel(r"Coulomb friction $\sigma$")
    steps = (np.arange(_LABEL_GRID) + 0.5) / _LABEL_GRID
    betas, sigmas = steps * beta_max, steps * sigma_max
    named = [[name(Dimensionless(mu, b, s, tau_d), xi_dot_max) for s in sigmas.tolist()] for b in betas.tolist()]
    places = middles(betas, sigmas, np.array(named), _LEAST_SHARE)
    for letter, (beta, sigma) in places.items():
        text = (names or {}).get(letter, letter)
        axes.text(beta, sigma, text, ha="center", va="center", fontsize=9, weight="bold" if text == letter else None)
    return places
