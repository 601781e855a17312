"""Fig. 5: the regions with delay; A splits into F1 and F2."""

from __future__ import annotations

import numpy as np

from hapticd.figures.style import GREEN, new_figure
from hapticd.reproduce.items import Comparison, Item, Progress, compare
from hapticd.reproduce.plane import critical_line, draw_plane
from hapticd.stability.criterion import lambda_
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.regions import region
from hapticd.stability.storage import FloatArray

MU, TAU_D, XI_DOT = 100.0, 1.25, 1.0
_NAMES = {
    "F1": "F1\nstable, energy\nalways falls",
    "F2": "F2  stable, energy may rise briefly",
    "B": "B\nsmall limit cycles",
    "C": "C\nunstable",
    "D": "D\nlocally unstable",
    "E": "E\nlocally stable",
}


def acceleration_bound(mu: float, beta: FloatArray | float, sigma: FloatArray | float, xi_dot_max: float) -> FloatArray:
    """A-priori ξ̈_max = (φ_max + σ + βξ̇_max)/μ of (20), which the paper leaves open; φ_max ≤ ξ̇_max√μ + ½ by the energy."""
    return np.asarray((xi_dot_max * np.sqrt(mu) + 0.5 + sigma + beta * xi_dot_max) / mu)


def printed_line(mu: float, tau_d: float, xi_dot_max: float, beta: FloatArray) -> FloatArray:
    """(n,) σ of (19) and of its second condition; ξ̈_max contains σ itself, so the linear equation is solved for it."""
    share = (tau_d * tau_d + tau_d) / mu
    line = 0.5 + share * mu * acceleration_bound(mu, beta, 0.0, xi_dot_max)
    return np.asarray((line + np.maximum(0.0, xi_dot_max * (0.5 + tau_d - beta))) / (1.0 - share))


def printed_region(numbers: Dimensionless, xi_dot_max: float) -> str:
    """The region of Fig. 5 as (19) with both conditions divides it."""
    n = numbers
    enough = n.beta >= 0.5 + n.tau_d
    if n.sigma < 0.5:
        return "B" if enough else "C"
    holds = n.sigma >= float(printed_line(n.mu, n.tau_d, xi_dot_max, np.array([n.beta]))[0])
    return ("F1" if holds else "F2") if enough else ("E" if holds else "D")


def build(quick: bool, progress: Progress) -> Item:
    """Draw the figure."""
    figure = new_figure(6.8, 4.8)
    axes = figure.subplots()
    middles = draw_plane(axes, MU, TAU_D, XI_DOT, 3.2, 3.0, _NAMES, printed_line, printed_region)
    wide = np.linspace(0.0, 3.2, 321)
    axes.plot(wide, critical_line(MU, TAU_D, XI_DOT, wide), color=GREEN, lw=1.4, ls="--")
    axes.text(3.17, 0.54, "enough for a proof (theorem 2)", color=GREEN, fontsize=8.5, ha="right")
    axes.text(0.05, 2.62, r"critical line (19)", color="#8a1c12", fontsize=8.5)
    axes.text(3.17, 1.02, "second condition of (19)", color="#8a1c12", fontsize=8.5, ha="right")
    corner = 0.5 + TAU_D
    sigma = float(printed_line(MU, TAU_D, XI_DOT, np.array([corner]))[0])
    acceleration = float(acceleration_bound(MU, corner, sigma, XI_DOT))
    return Item(
        name="fig5",
        title="Fig. 5: regions with delay",
        see=(
            "The same plane with τ_D = 1.25 (μ = 100, ξ̇_max = 1). The vertical border moves from β = ½ to ½ + τ_D = 1.75; "
            "Coulomb friction must now also make up for acceleration during the delay. What was A splits: F1, where energy "
            "falls all the time, and F2, where it may rise briefly and the loop is stable all the same.",
            "The dashed green line is ours: above it ½μξ̇² + ½ξ² never exceeds what it was at the start, without ξ̈_max. "
            "hapticd's own F1 is all of the plane above it on the right, and F2 what little is left.",
        ),
        traps=(
            "(19) as printed is one condition and lets F2 and B slip in. It needs a second one, as (12) has: "
            "σ ≥ ½ + ξ̈_max(τ_D² + τ_D), the dashed line. It is the border between F1 and F2.",
            "ξ̈_max is never defined in the paper. Here it is the a-priori bound (φ_max + σ + βξ̇_max)/μ, with φ_max from the "
            "initial energy; so the lines bend slightly with β.",
            f"Where the delay is no whole number of periods, β = ½ + τ_D is not quite enough at every speed: λ = "
            f"{float(lambda_(TAU_D)):.4g} is.",
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
    names = region, printed_region
    below, above = (
        " ".join(name(Dimensionless(MU, b, 3.0, TAU_D), 1e-3) for name in names) for b in (corner - 1e-9, corner + 1e-9)
    )
    return [
        Comparison(
            "regions with delay", "paper, Fig. 5", "B, C, D, E, F1, F2", ", ".join(sorted(middles)),
            sorted(middles) == ["B", "C", "D", "E", "F1", "F2"],
        ),
        Comparison(
            "names beside β = ½ + τ_D = 1.75, ours and (19)'s", "paper, eq. 19", "E E, F1 F1", f"{below}, {above}",
            (below, above) == ("E E", "F1 F1"),
        ),
        compare(
            "σ of the lines at β = 1.75", "paper, eq. 61", 0.5 + acceleration * (TAU_D**2 + TAU_D), sigma, 1e-9,
            note="solved for σ, which ξ̈_max contains itself",
        ),
    ]  # fmt: skip
