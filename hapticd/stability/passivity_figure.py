"""The figure beside Fig. 6: which points of the (β, σ) plane the passivity controller makes stable."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from hapticd.stability.map_figure import Shades, patches, plane
from hapticd.stability.passivity_map import PassivityMap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Of the classes CALM_ANYWAY … SPOILT of `passivity_map`.
_SHADES: Final[Shades] = (
    ("#ffffff", "comes to rest without it"),
    ("#7fb2d9", "made stable"),
    ("#f0c674", "goes on, bounded: below the encoder's grain, or σ < ½"),
    ("#4a4a4a", "still grows"),
    ("#c0392b", "came to rest without it only"),
)


def draw(found: PassivityMap) -> Figure:
    """Rows by delay and counts a tick, columns by initial velocity."""
    from matplotlib.figure import Figure

    study = found.study
    rows = [(d, counts) for d in range(len(study.delays)) for counts in found.counts]
    columns = len(study.velocities)
    figure = Figure(figsize=(2.7 * columns + 1.0, 2.5 * len(rows) + 1.0), layout="constrained")
    panels = figure.subplots(len(rows), columns, squeeze=False)
    for row, (d, counts) in enumerate(rows):
        for v, velocity in enumerate(study.velocities):
            axes = panels[row, v]
            plane(axes, study, study.delays[d], velocity, found.classes[counts][d, v], _SHADES)
            if row == len(rows) - 1:
                axes.set_xlabel("$\\beta$")
            if v == 0:
                axes.set_ylabel(f"{counts} count{'s' if counts > 1 else ''} a tick\n$\\sigma$")
    figure.legend(handles=patches(_SHADES), loc="outside lower center", ncols=3 if columns > 2 else 1, fontsize=8)
    figure.suptitle(f"What the passivity controller makes of the points of Fig. 6 ($\\mu$ = {study.mu:g})", fontsize=11)
    return figure
