"""The figure beside Fig. 6: which points of the (β, σ) plane the passivity controller makes stable."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapticd.figures.files import save_figure
from hapticd.stability.map_figure import boundaries, edges
from hapticd.stability.passivity_map import BOUNDED, CALM_ANYWAY, MADE_STABLE, SPOILT, STILL_GROWS, PassivityMap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHADES: Final = {
    CALM_ANYWAY: ("#ffffff", "comes to rest without it"),
    MADE_STABLE: ("#7fb2d9", "made stable"),
    BOUNDED: ("#f0c674", "goes on, bounded: below the encoder's grain, or σ < ½"),
    STILL_GROWS: ("#4a4a4a", "still grows"),
    SPOILT: ("#c0392b", "came to rest without it only"),
}
_LINE: Final = "#c0392b"


def draw(found: PassivityMap) -> Figure:
    """Rows by delay and counts a tick, columns by initial velocity."""
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    study = found.study
    rows = [(d, counts) for d in range(len(study.delays)) for counts in found.counts]
    columns = len(study.velocities)
    figure = Figure(figsize=(2.7 * columns + 1.0, 2.5 * len(rows) + 1.0), layout="constrained")
    panels = figure.subplots(len(rows), columns, squeeze=False)
    colours = ListedColormap([shade for shade, _ in _SHADES.values()])
    for row, (d, counts) in enumerate(rows):
        tau_d = study.delays[d]
        beta, sigma = study.betas(tau_d), study.sigmas
        for v, velocity in enumerate(study.velocities):
            axes = panels[row, v]
            fate = found.fate[counts][d, v]
            axes.pcolormesh(
                edges(beta), edges(sigma), fate.T, cmap=colours, vmin=-0.5, vmax=len(_SHADES) - 0.5, rasterized=True
            )
            lines = boundaries(study.mu, tau_d, velocity, np.linspace(0.0, edges(beta)[-1], 301))
            for line in lines.values():
                axes.plot(line[:, 0], line[:, 1], color=_LINE, lw=0.8)
            axes.set_xlim(0.0, edges(beta)[-1])
            axes.set_ylim(0.0, edges(sigma)[-1])
            axes.set_title(f"$\\tau_D$ = {tau_d:g}, $\\dot\\xi_0$ = {velocity:g}", fontsize=9)
            if row == len(rows) - 1:
                axes.set_xlabel("$\\beta$")
            if v == 0:
                axes.set_ylabel(f"{counts} count{'s' if counts > 1 else ''} a tick\n$\\sigma$")
    handles: list[Any] = [Patch(facecolor=shade, edgecolor="0.4", label=label) for shade, label in _SHADES.values()]
    figure.legend(handles=handles, loc="outside lower center", ncols=3 if columns > 2 else 1, fontsize=8)
    figure.suptitle(f"What the passivity controller makes of the points of Fig. 6 ($\\mu$ = {study.mu:g})", fontsize=11)
    return figure


def save(found: PassivityMap, path: Path) -> None:
    """Write the figure in the format that the path's suffix names (png, svg, pdf)."""
    save_figure(draw(found), path, dpi=120)
