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
    beta: FloatArray, sigma: FloatArray, names: NDArray[np.str_], least: float = 0.0
) -> dict[str, tuple[float, float]]:
    """Region → (β, σ) of its middle, asked of the name of each point and not of lines.

    Args:
        beta, sigma: (n,) and (m,) places of either axis, as far from each other as they are drawn. names: (n, m) of regions.
        least: share of the plane that a name needs.
    """
    told = {}
    for name in sorted(set(names.ravel().tolist())):
        points = np.argwhere(names == name)
        if len(points) >= least * names.size:
            j, k = points.mean(axis=0)
            told[name] = (
                float(np.interp(j, np.arange(beta.size), beta)),
                float(np.interp(k, np.arange(sigma.size), sigma)),
            )
    return told
