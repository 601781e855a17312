"""The figure of a Z-width: the boundary of the linear loop in each hand, and the worst case of the device."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from hapticd.figures.style import BLUE, new_figure, prefixed
from hapticd.stability.figures.map import Shades, edges, patches, shade
from hapticd.stability.zwidth import ZWidth

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Of `VERDICTS`.
_SHADES: Final[Shades] = (
    ("#ffffff", "comes to rest"),
    ("#dcdcdc", "oscillates, below one tick"),
    ("#a6a6a6", "oscillates, one tick and more"),
    ("#6b6b6b", "grows"),
)
_LINEAR, _EXACT, _PASSIVE = "#c0392b", "#000000", "#2e7d32"
_HANDS: Final = ("#c0392b", "#d4803a", "#b9a03a", "#7a8a3a", "#3a8a8a")


def draw(found: ZWidth, title: str) -> Figure:
    """Two panels over the same B."""
    linear = found.config.is_linear
    speed = "m/s" if linear else "rad/s"
    per_K, K_unit = prefixed(found.stiffness[-1], "N/m" if linear else "N m/rad")
    per_B, B_unit = prefixed(found.damping[-1], "N s/m" if linear else "N m s/rad")
    B, K = found.damping / per_B, found.stiffness / per_K
    figure = new_figure(10.0, 5.2)
    left, right = figure.subplots(1, 2, sharex=True)
    for held, colour in zip(found.held, _HANDS, strict=False):
        left.plot(B, held.linear / per_K, color=colour, lw=1.6, label=held.name)
    left.set_title("the linear loop is stable below (Hulin)", fontsize=10)
    left.set_ylim(0.0, 1.4 * max(1e-9, *(held.linear.max() / per_K for held in found.held)))
    left.legend(fontsize=8, loc="upper right", frameon=True, framealpha=0.9)

    edges_B, edges_K = edges(B, B[1]), edges(K, K[0])
    edges_K[0] = 0.0
    shade(right, edges_B, edges_K, found.outcome, _SHADES)
    lines = [
        *right.plot(B, found.exact / per_K, color=_EXACT, lw=1.4, label="calm below"),
        *right.plot(B, found.linear / per_K, "--", color=_LINEAR, lw=1.6, label="the linear loop is stable below"),
        *right.plot(B, found.passive / per_K, color=_PASSIVE, lw=1.8, label="passive below (Colgate and Schenkel)"),
    ]
    spring = found.config.spring
    place = spring.damping / per_B, spring.stiffness / per_K
    if 0.0 < place[1] <= edges_K[-1] and place[0] <= edges_B[-1]:
        lines += right.plot(*place, "o", color=BLUE, ms=7, mec="white", clip_on=False, zorder=5, label="this config")
    right.set_title("ticks and friction: the worst of all hands and speeds", fontsize=10)
    right.set_ylim(0.0, edges_K[-1])
    for axes in (left, right):
        axes.set_xlim(0.0, edges_B[-1])
        axes.locator_params(nbins=6)
        axes.set_xlabel(f"virtual damping B ({B_unit})")
        axes.set_ylabel(f"stiffness K ({K_unit})")
    figure.legend(handles=[*patches(_SHADES), *lines], loc="outside lower center", ncols=4, fontsize=8)
    figure.suptitle(f"Z-width of {title}: motions through the origin of up to {found.fastest:.3g} {speed}", fontsize=11)
    return figure
