"""Fig. 5: the regions with delay; A splits into F1 and F2."""

from __future__ import annotations

import numpy as np

from hapticd.figures.style import new_figure
from hapticd.reproduce.items import Comparison, Item, Progress, compare
from hapticd.reproduce.plane import critical_line, draw_plane
from hapticd.stability.criterion import xi_ddot_bound
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.regions import region

MU, TAU_D, XI_DOT = 100.0, 1.25, 1.0
_NAMES = {
    "F1": "F1\nstable, energy\nalways falls",
    "F2": "F2  stable, energy may rise briefly",
    "B": "B\nsmall limit cycles",
    "C": "C\nunstable",
    "D": "D\nlocally unstable",
    "E": "E\nlocally stable",
}


def build(quick: bool, progress: Progress) -> Item:
    """Draw the figure."""
    figure = new_figure(6.8, 4.8)
    axes = figure.subplots()
    middles = draw_plane(axes, MU, TAU_D, XI_DOT, 3.2, 3.0, _NAMES)
    axes.text(0.05, 2.62, r"critical line (19)", color="#8a1c12", fontsize=8.5)
    axes.text(3.17, 1.02, "second condition of (19)", color="#8a1c12", fontsize=8.5, ha="right")
    corner = 0.5 + TAU_D
    sigma = float(critical_line(MU, TAU_D, XI_DOT, np.array([corner]))[0])
    acceleration = float(xi_ddot_bound(MU, corner, sigma, XI_DOT))
    return Item(
        name="fig5",
        title="Fig. 5: regions with delay",
        see=(
            "The same plane with τ_D = 1.25 (μ = 100, ξ̇_max = 1). The vertical border moves from β = ½ to ½ + τ_D = 1.75; "
            "Coulomb friction must now also make up for acceleration during the delay. What was A splits: F1, where energy "
            "falls all the time, and F2, where it may rise briefly and the loop is stable all the same.",
        ),
        traps=(
            "(19) as printed is one condition and lets F2 and B slip in. It needs a second one, as (12) has: "
            "σ ≥ ½ + ξ̈_max(τ_D² + τ_D), the dashed line. It is the border between F1 and F2.",
            "ξ̈_max is never defined in the paper. Here it is the a-priori bound (φ_max + σ + βξ̇_max)/μ, with φ_max from the "
            "initial energy; so the lines bend slightly with β.",
            "As without delay, the proof holds with 1 in place of ½, for energies compared at h + τ_D.",
        ),
        figure=figure,
        alt="The (β, σ) plane for delay 1.25: regions C and B below one half, D, E, F2 and F1 above.",
        comparisons=_comparisons(middles, sigma, acceleration),
        numbers={
            "mu": MU,
            "tau_d": TAU_D,
            "xi_dot_max": XI_DOT,
            "corner": [corner, sigma],
            "xi_ddot_max": acceleration,
        },
    )


def _comparisons(middles: dict[str, tuple[float, float]], sigma: float, acceleration: float) -> list[Comparison]:
    corner = 0.5 + TAU_D
    below, above = (region(Dimensionless(MU, b, 3.0, TAU_D), 1e-3) for b in (corner - 1e-9, corner + 1e-9))
    return [
        Comparison(
            "regions with delay", "paper, Fig. 5", "B, C, D, E, F1, F2", ", ".join(sorted(middles)),
            sorted(middles) == ["B", "C", "D", "E", "F1", "F2"],
        ),
        Comparison(
            "names beside β = ½ + τ_D = 1.75", "paper, eq. 19", "E, F1", f"{below}, {above}", (below, above) == ("E", "F1")
        ),
        compare(
            "σ of the lines at β = 1.75", "paper, eq. 61", 0.5 + acceleration * (TAU_D**2 + TAU_D), sigma, 1e-9,
            note="solved for σ, which ξ̈_max contains itself",
        ),
    ]  # fmt: skip
