"""The figure of Fig. 6 and 7: outcomes in four shades, the theoretical boundaries drawn over them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.figures.plane import middles
from hapticd.figures.style import new_figure
from hapticd.stability.criterion import lambda_
from hapticd.stability.map_report import regions_of
from hapticd.stability.maps import Maps, Study
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.outcome import OUTCOMES
from hapticd.stability.regions import critical_sigma
from hapticd.stability.storage import FloatArray, velocity_bound

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Shades = Sequence[tuple[str, str]]
"""Colour and meaning of the codes 0, 1, … of a map."""

#: The paper's shades of `OUTCOMES`: dark growing, medium persistent, light non-monotonically decaying, white monotone.
_SHADES: Final[Shades] = (
    ("#ffffff", "comes to rest, energy always falls"),
    ("#d9d9d9", "comes to rest, energy rises in between"),
    ("#9a9a9a", "persistent oscillation"),
    ("#4a4a4a", "growing"),
    ("#fff3c4", "not done"),
)
_LINE: Final = "#c0392b"


def boundaries(mu: float, tau_d: float, xi_dot_0: float, beta: FloatArray) -> dict[str, FloatArray]:
    """The lines between regions: each (n, 2) of (β, σ), in the paper's criterion.

    Returns:
        ``viscous`` β = ½ + τ_D (17), ``coulomb`` σ = ½ (18), ``critical`` the line of (12), with delay that of theorem 2.
    """
    numbers = Dimensionless(mu, 0.0, 0.0, tau_d)
    bound = float(velocity_bound(0.0, xi_dot_0, mu, tau_d))
    line = 0.5 + tau_d
    # to the right of the corner, up to λ, it is the boundary between F1 and F2
    end = float(lambda_(tau_d))
    critical_beta = np.unique(np.append(beta[beta < end], [line, end]))
    return {
        "viscous": np.array([[line, 0.0], [line, 1e6]]),
        "coulomb": np.array([[0.0, 0.5], [1e6, 0.5]]),
        "critical": np.column_stack([critical_beta, critical_sigma(numbers, bound, critical_beta)]),
    }


def draw(maps: Maps) -> Figure:
    """One panel per map: rows by delay, columns by initial velocity."""
    study = maps.study
    rows, columns = len(study.delays), len(study.velocities)
    figure = new_figure(3.1 * columns + 0.6, 3.0 * rows + 1.0)
    panels = figure.subplots(rows, columns, squeeze=False)
    for d, tau_d in enumerate(study.delays):
        for v, velocity in enumerate(study.velocities):
            axes = panels[d, v]
            codes = np.where(maps.done[d, v], maps.points["outcome"][d, v], len(OUTCOMES))
            plane(axes, study, tau_d, velocity, codes, _SHADES)
            _name_regions(axes, maps, d, v)
            if d == rows - 1:
                axes.set_xlabel("$\\beta$")
            if v == 0:
                axes.set_ylabel("$\\sigma$")
    handles = patches(_SHADES[:-1] if maps.done.all() else _SHADES)
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles) if columns > 2 else 1, fontsize=9)
    figure.suptitle(
        f"Outcome of {study.periods} periods at $\\mu$ = {study.mu:g}, with the boundaries of theory", fontsize=11
    )
    return figure


def plane(axes: Axes, study: Study, tau_d: float, velocity: float, codes: NDArray[Any], shades: Shades) -> None:
    """A (β, σ) plane of a study, each point in the shade of its code (β, σ), with the boundaries."""
    beta, sigma = (edges(centres, centres[0]) for centres in (study.betas(tau_d), study.sigmas))
    shade(axes, beta, sigma, codes, shades)
    lines = boundaries(study.mu, tau_d, velocity, np.linspace(0.0, beta[-1], 301))
    for name, line in lines.items():
        axes.plot(line[:, 0], line[:, 1], color=_LINE, lw=1.4 if name == "critical" else 0.9)
    axes.set_xlim(0.0, beta[-1])
    axes.set_ylim(0.0, sigma[-1])
    axes.set_title(f"$\\tau_D$ = {tau_d:g}, $\\dot\\xi_0$ = {velocity:g}", fontsize=10)


def shade(axes: Axes, x: FloatArray, y: FloatArray, codes: NDArray[Any], shades: Shades) -> None:
    """Cells with the borders ``x`` (n + 1,) and ``y`` (m + 1,) in the shades of their codes (n, m)."""
    from matplotlib.colors import ListedColormap

    colours = ListedColormap([colour for colour, _ in shades])
    axes.pcolormesh(x, y, codes.T, cmap=colours, vmin=-0.5, vmax=len(shades) - 0.5, rasterized=True)


def patches(shades: Shades) -> list[Any]:
    """Legend entries of the shades."""
    from matplotlib.patches import Patch

    return [Patch(facecolor=colour, edgecolor="0.4", label=label) for colour, label in shades]


def _name_regions(axes: Axes, maps: Maps, delay: int, velocity: int) -> None:
    beta, sigma = maps.study.betas(maps.study.delays[delay]), maps.study.sigmas
    box = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}
    for name, place in middles(beta, sigma, regions_of(maps, delay, velocity)).items():
        axes.text(*place, name, color=_LINE, weight="bold", ha="center", va="center", fontsize=9, bbox=box)


def edges(centres: FloatArray, step: float) -> FloatArray:
    """Borders of the cells around evenly spaced centres."""
    return np.asarray(np.append(centres - 0.5 * step, centres[-1] + 0.5 * step))
