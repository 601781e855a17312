"""The (β, σ) plane: regions shaded, each in its colour, and where their names go, on linear and logarithmic axes."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hapticd.figures.style import REGION

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FloatArray = NDArray[np.float64]


def shade_regions(
    axes: Axes,
    beta: FloatArray,
    sigma: FloatArray,
    corner: float,
    quantum: float,
    line: Callable[[FloatArray], FloatArray],
) -> None:
    """Shade C, D and E left of the corner, B, F2 and A right of it.

    Args:
        axes: where. beta, sigma: places of either axis, rising, the whole of it.
        corner: β at which sides change. quantum: σ of the horizontal border.
        line: (n,) β → (n,) σ of the critical line.
    """
    left, right = np.append(beta[beta < corner], corner), np.append(corner, beta[beta > corner])
    for side, (under, between, over) in ((left, ("C", "D", "E")), (right, ("B", "F2", "A"))):
        edge = np.clip(line(side), quantum, sigma[-1])
        axes.fill_between(side, sigma[0], quantum, color=REGION[under], lw=0)
        axes.fill_between(side, quantum, edge, color=REGION[between], lw=0, alpha=0.65 if between == "D" else 1.0)
        axes.fill_between(side, edge, sigma[-1], color=REGION[over], lw=0)


def middles(
    beta: FloatArray, sigma: FloatArray, name: Callable[[float, float], str], least: float = 0.012
) -> dict[str, tuple[float, float]]:
    """Region → (β, σ) of its middle, asked of the name of each point and not of lines, where there is room for a name.

    Args:
        beta, sigma: places of either axis, as far from each other as they are drawn. name: of the region of a point.
        least: share of the plane that a name needs.
    """
    found: dict[str, list[tuple[int, int]]] = {}
    for j, b in enumerate(beta.tolist()):
        for k, s in enumerate(sigma.tolist()):
            found.setdefault(name(b, s), []).append((j, k))
    told = {
        letter: np.mean(points, axis=0)
        for letter, points in sorted(found.items())
        if len(points) >= least * beta.size * sigma.size
    }
    return {
        letter: (float(np.interp(j, np.arange(beta.size), beta)), float(np.interp(k, np.arange(sigma.size), sigma)))
        for letter, (j, k) in told.items()
    }
