"""The figure of a Z-width: the (B, K) plane in four variants, with the linear limit and the passive one over it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from hapticd.stability.map_figure import Shades, patches, shade
from hapticd.stability.zwidth import ZWidth

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Of the outcomes DIES_OUT … GROWS of `zwidth`.
_SHADES: Final[Shades] = (
    ("#ffffff", "dies out"),
    ("#d9d9d9", "goes on, below one tick"),
    ("#9a9a9a", "goes on, one tick and more"),
    ("#4a4a4a", "grows"),
)
_TITLES: Final = {
    "linear": "no ticks, no Coulomb friction",
    "coulomb": "Coulomb friction, no ticks",
    "ticks": "ticks, no Coulomb friction",
    "ticks and coulomb": "ticks and Coulomb friction: the device",
}
_LINEAR, _PASSIVE, _POINT = "#c0392b", "#0b5fa5", "#0b5fa5"


def draw(found: ZWidth, title: str) -> Figure:
    """Four panels."""
    from matplotlib.figure import Figure

    linear = found.config.is_linear
    figure = Figure(figsize=(9.0, 7.6), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    handles = patches(_SHADES)
    step_B, step_K = found.damping[1], found.stiffness[0]
    edges_B = np.append(found.damping - 0.5 * step_B, found.damping[-1] + 0.5 * step_B)
    edges_K = np.append(found.stiffness - 0.5 * step_K, found.stiffness[-1] + 0.5 * step_K)
    limit = found.largest("linear")
    for axes, (variant, outcome) in zip(panels.ravel(), found.outcome.items(), strict=True):
        shade(axes, edges_B, edges_K, outcome, _SHADES)
        (border,) = axes.plot(
            found.damping, limit + 0.5 * step_K, color=_LINEAR, lw=1.3, label="limit of the linear loop"
        )
        (passive,) = axes.plot(
            found.damping, found.passive, color=_PASSIVE, lw=1.6, label="passive below (Colgate and Schenkel)"
        )
        axes.set_title(_TITLES[variant], fontsize=10)
        axes.set_xlim(0.0, edges_B[-1])
        axes.set_ylim(0.0, edges_K[-1])
    handles += [border, passive]
    for axes in panels[1]:
        axes.set_xlabel("virtual damping B (N s/m)" if linear else "virtual damping B (N m s/rad)")
    for axes in panels[:, 0]:
        axes.set_ylabel("stiffness K (N/m)" if linear else "stiffness K (N m/rad)")
    spring = found.config.spring
    if 0.0 < spring.stiffness <= edges_K[-1] and spring.damping <= edges_B[-1]:
        (point,) = panels[1, 1].plot(
            spring.damping, spring.stiffness, "o", color=_POINT, ms=7, label="this config", clip_on=False
        )
        handles.append(point)
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8)
    figure.suptitle(
        f"Z-width of {title}: motions that pass the origin at {found.velocity:g} ticks per period", fontsize=11
    )
    return figure
