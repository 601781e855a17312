"""Fig. 4: effects of K, T and Δ on the operating point, and the devices of Table II."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, cast

import numpy as np

from hapticd.figures.style import BLUE, GREY, INK, ORANGE, new_figure
from hapticd.reproduce.items import Comparison, Item, Progress, compare
from hapticd.reproduce.plane import draw_plane
from hapticd.stability.devices import TABLE_II
from hapticd.stability.numbers import Dimensionless, Scales, physical
from hapticd.stability.tuning import Parameter, path

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Start of the arrows, and the factor of each parameter at their ends.
START: Final = (0.8, 1.6)
FACTORS: Final = {"stiffness": 2.4, "period": 2.6, "resolution": 2.6}
_LABELS: Final = {"stiffness": ("K", (-4, -14)), "period": ("T", (-14, 6)), "resolution": (r"$\Delta$", (7, -4))}
_OFFSETS: Final = {
    "Delta": (6, 5), "Freedom 6": (8, -13), "Impulse Engine": (-58, 9), "MIT Toolhandle": (6, 6), "Omega": (6, -12),
    "Phantom 1.0": (6, 5),
}  # fmt: skip


def build(quick: bool, progress: Progress) -> Item:
    """Draw the figure."""
    figure = new_figure(10.0, 4.5)
    left, right = figure.subplots(1, 2)
    ends = _effects(left)
    _devices(right)
    (beta_k, sigma_k), (_, sigma_t), (beta_d, _) = ends.values()
    slope = (START[1] - sigma_k) / (START[0] - beta_k)
    inside = [d for d in TABLE_II if d.loop.numbers.beta < 0.5 <= d.loop.numbers.sigma]
    return Item(
        name="fig4",
        title="Fig. 4: effects of stiffness, sampling time and encoder step",
        see=(
            "Left: a stiffer spring moves the point straight towards the origin, a longer period to the left, a coarser "
            "encoder down. All three lead out of A; the arrows end at 2.4 and 2.6 times the value.",
            "Right: the devices of Table II at the largest stiffness that they render, from our numbers (dots; crosses as "
            "printed). All lie in the strip of region E, β ≪ ½ and σ > ½: only Coulomb friction makes them stable.",
        ),
        traps=("Freedom 6 appears twice: its printed β is 0.025, its row gives 0.0042.",),
        figure=figure,
        alt="Left, three arrows from one point of the plane. Right, six devices over a logarithmic β axis.",
        comparisons=[
            compare("direction under K: σ/β stays", "paper, Sec. III-C", START[1] / START[0], slope, 1e-9),
            compare("σ under T", "paper, Sec. III-C: unchanged", START[1], sigma_t, 1e-12),
            compare("β under Δ", "paper, Sec. III-C: unchanged", START[0], beta_d, 1e-12),
            Comparison(
                "devices in the strip of E", "paper, Sec. III-B", "all six", f"{len(inside)} of {len(TABLE_II)}",
                len(inside) == len(TABLE_II),
            ),
        ],
        numbers={
            "start": list(START),
            "ends": {name: list(end) for name, end in ends.items()},
            "devices": {d.name: [d.loop.numbers.beta, d.loop.numbers.sigma] for d in TABLE_II},
        },
    )  # fmt: skip


def _effects(axes: Axes) -> dict[str, tuple[float, float]]:
    draw_plane(axes, 100.0, 0.0, 2.0, 1.2, 2.0)
    loop = physical(Dimensionless(100.0, *START), Scales(1.0, 1.0, 1.0))
    ends = {}
    for name, factor in FACTORS.items():
        beta, sigma = path(loop, cast(Parameter, name), np.array([1.0, factor]))
        ends[name] = (float(beta[1]), float(sigma[1]))
        axes.annotate("", ends[name], START, arrowprops={"arrowstyle": "-|>", "color": BLUE, "lw": 1.8})
        symbol, offset = _LABELS[name]
        axes.annotate(
            f"{symbol}↑", ends[name], offset, textcoords="offset points", color=BLUE, fontsize=11, weight="bold"
        )
    axes.plot([0.0, START[0]], [0.0, START[1]], color=BLUE, lw=0.8, ls=":")
    axes.plot(*START, "o", color=BLUE, ms=7)
    axes.set_title("effects of K, T and Δ")
    return ends


def _devices(axes: Axes) -> None:
    axes.set_xscale("log")
    axes.set_xlim(2e-4, 1.0)
    axes.set_ylim(0.0, 2.3)
    axes.axhspan(0.0, 0.5, color="#f6d0cc", lw=0)
    axes.axhspan(0.5, 2.3, color="#e4f2d5", lw=0)
    axes.axvspan(0.5, 1.0, 0.0, 0.5 / 2.3, color="#fdebc8", lw=0)
    axes.axvspan(0.5, 1.0, 0.5 / 2.3, 1.0, color="#cfe8cf", lw=0)
    for name, beta, sigma in (("E | D", 3.6e-4, 2.17), ("C", 3.6e-4, 0.2), ("A", 0.7, 2.17), ("B", 0.7, 0.2)):
        axes.text(beta, sigma, name, ha="center", va="center", fontsize=9, weight="bold")
    axes.axhline(0.5, color=INK, lw=0.9)
    axes.axvline(0.5, color=INK, lw=0.9)
    for device in TABLE_II:
        beta, sigma = device.loop.numbers.beta, device.loop.numbers.sigma
        printed = float(device.beta), float(device.sigma)
        axes.plot([beta, printed[0]], [sigma, printed[1]], color=GREY, lw=0.8)
        axes.plot(*printed, "x", color=ORANGE, ms=6, label="as printed" if device is TABLE_II[0] else None)
        axes.plot(beta, sigma, "o", color=BLUE, ms=5, label="recomputed" if device is TABLE_II[0] else None)
        axes.annotate(device.name, (beta, sigma), _OFFSETS[device.name], textcoords="offset points", fontsize=8.5)
    axes.set_xlabel(r"viscous friction $\beta$")
    axes.set_ylabel(r"Coulomb friction $\sigma$")
    axes.set_title("the devices of Table II")
    axes.legend(loc="upper center", ncols=2)
