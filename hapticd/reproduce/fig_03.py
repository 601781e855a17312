"""Fig. 3: the regions of the (β, σ) plane without delay."""

from __future__ import annotations

import numpy as np

from hapticd.figures.style import RED, new_figure
from hapticd.reproduce.items import Comparison, Item, Progress, compare
from hapticd.reproduce.plane import critical_line, draw_plane
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.regions import region

#: Velocity bound of the figure in ticks per period; the paper does not give it.
XI_DOT = 2.0
OTHERS = (0.5, 8.0)
MU = 100.0
_NAMES = {
    "A": "A\nglobally stable,\npassive",
    "B": "B\nsmall limit cycles",
    "C": "C\nunstable",
    "D": "D\nlocally\nunstable",
    "E": "E\nlocally\nstable",
}


def build(quick: bool, progress: Progress) -> Item:
    """Build the item."""
    figure = new_figure(6.6, 4.8)
    axes = figure.subplots()
    middles = draw_plane(axes, MU, 0.0, XI_DOT, 1.1, 1.8, _NAMES)
    beta = np.linspace(0.0, 0.5, 101)
    for speed in OTHERS:
        axes.plot(beta, critical_line(MU, 0.0, speed, beta), color=RED, lw=1.0, ls=":")
    axes.annotate(
        r"critical line, $\dot\xi_{\max}=2$", (0.07, 1.36), (0.03, 1.62), color=RED, fontsize=8.5,
        arrowprops={"arrowstyle": "-", "color": RED, "lw": 0.7},
    )  # fmt: skip
    axes.text(0.012, 0.79, r"$\dot\xi_{\max}=\frac{1}{2}$", color=RED, fontsize=8.5)
    axes.text(0.375, 1.66, r"$\dot\xi_{\max}=8$", color=RED, fontsize=8.5)
    return Item(
        name="fig3",
        title="Fig. 3: regions of the (β, σ) plane without delay",
        see=(
            "Five regions around the point (½, ½). In A friction dissipates enough at every speed. In B viscous friction is "
            "enough for fast motions, but the force step of one tick causes a limit cycle. In C it never is. "
            "Between D and E it depends on the speed: the critical line turns about (½, ½) with slope −ξ̇_max, shown for "
            "three speeds in ticks per period.",
        ),
        traps=(
            "The paper's proof uses the energy (35), and its bound (46) fails just past an encoder edge. With ½μξ̇² + ½ξ² "
            "instead of (35) the bound holds, and the regions are a theorem: in A and E this energy falls in every period. "
            "The energy (35) may rise in single periods: see the example under Fig. 9.",
        ),
        figure=figure,
        alt="The (β, σ) plane, cut into regions A to E by lines through the point (½, ½).",
        comparisons=_comparisons(middles),
        numbers={"xi_dot_max": XI_DOT, "middles": {name: list(place) for name, place in middles.items()}},
    )  # fmt: skip


def _comparisons(middles: dict[str, tuple[float, float]]) -> list[Comparison]:
    corner, origin = critical_line(MU, 0.0, XI_DOT, np.array([0.5, 0.0])).tolist()
    names = [region(Dimensionless(MU, *place), XI_DOT) for place in middles.values()]
    return [
        compare("σ of the critical line at β = ½", "paper, eq. 12", 0.5, corner, 1e-12),
        compare("slope of the critical line", "paper, eq. 51: −ξ̇_max", -XI_DOT, (corner - origin) / 0.5, 1e-12),
        Comparison(
            "regions around (½, ½)", "paper, Sec. III-B", "A, B, C, D, E", ", ".join(sorted(middles)),
            sorted(middles) == list("ABCDE") and names == list(middles),
        ),
    ]  # fmt: skip
