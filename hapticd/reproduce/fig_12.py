"""Fig. 12: amplitude and frequency of the small and the large limit cycles on the (β, σ) plane, μ = 5."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.figures.style import GREY, INK, new_figure
from hapticd.reproduce.items import Cell, Comparison, Item, Progress, Table, compare
from hapticd.stability.cycles import within
from hapticd.stability.describing_function import (
    AMPLITUDE_TOLERANCE,
    encoder_gain,
    frequency,
    large_frequency_series,
    large_sigma,
    large_sigma_series,
    predicted_cycle,
    small_amplitude,
    small_sigma,
    stability_sigma,
)
from hapticd.stability.explore import Effort, explore_loop
from hapticd.stability.explored import Explored
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.whole_loop import bare_loop

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MU, TAU_L = 5.0, 0.5
#: Lines of the two maps: ω of the small family in rad per period, M of the large one in ticks.
OMEGAS = (0.4, 0.6, 0.8, 1.0, 1.3, 1.7, 2.2, 2.8)
AMPLITUDES = (1.5, 3.0, 5.0, 10.0, 20.0)
_BETA_SMALL, _BETA_LARGE = 4.0, 0.55
_BESIDE: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5), "reverse": True}


def build(quick: bool, progress: Progress) -> Item:
    """Draw the figure."""
    figure = new_figure(10.0, 4.7)
    left, right = figure.subplots(1, 2)
    _small(left)
    _large(right)
    progress(0.3)
    rows = _exact(256 if quick else 4096)
    omega = float(frequency(1.0, MU, TAU_L))
    return Item(
        name="fig12",
        title="Fig. 12: contours of amplitude and frequency, small and large oscillations",
        see=(
            "Left, small oscillations (70): one frequency and, by (69), one amplitude a line. All lie below σ = ½: with "
            "more friction nothing buzzes. Towards σ = ½ the amplitude falls steeply and ω rises to π/(2τ_L) = π.",
            "Right, large oscillations (72): lines of equal amplitude fan out from (½ + τ_D, 0). They are unstable: above "
            "the line of its amplitude a motion dies out, below it grows. Dashed, the same with D(M) kept whole.",
        ),
        traps=(
            "(71) is garbled in the text we have: the left sides are 1·cos τ_Lω and 1·sin τ_Lω, D(M) ≈ 1 in (62) and (66).",
            "(72) meets σ = 0 at β = sin(τ_Lω)/ω, a little left of τ_L: only the series (74) passes through (½ + τ_D, 0).",
            "The describing function knows no sampler. Below one tick the loop locks to a whole number of periods, one "
            "of several: the table says in which exact cycles starts end, with what share, and how many it meets.",
        ),
        figure=figure,
        alt="Two contour maps: lines falling with β below σ = ½, and a fan of straight lines that meet near β = ½.",
        tables=(_table(rows),),
        comparisons=[*_comparisons(omega), _met(rows)],
        numbers={
            "mu": MU, "tau_l": TAU_L, "omega_large": omega, "omega_large_series": large_frequency_series(MU, TAU_L),
            "small": [
                {
                    "omega": w, "amplitude": float(small_amplitude(w, MU, TAU_L)),
                    "sigma_at_beta_0": float(small_sigma(0.0, w, MU, TAU_L)),
                }
                for w in OMEGAS
            ],
            "large": [{"amplitude": M, "sigma_at_beta_0": float(large_sigma(0.0, M, MU, TAU_L))} for M in AMPLITUDES],
        },
    )  # fmt: skip


def _exact(starts: int) -> list[tuple[Dimensionless, Explored]]:
    """Exact final motions of starts up to ten ticks, at a few points of region B."""
    points = [Dimensionless(MU, beta, sigma) for beta in (0.6, 1.0, 2.0) for sigma in (0.0, 0.1, 0.2, 0.3)]
    effort = Effort(starts, 10_000_000, 40_000)
    return [(n, explore_loop(bare_loop(n), 10.0, effort=effort)) for n in points]


def _table(rows: list[tuple[Dimensionless, Explored]]) -> Table:
    """Limit cycles of the describing function, compared with those in exact simulations."""
    cells: list[tuple[Cell, ...]] = []
    for n, explored in rows:
        predicted = predicted_cycle(n)
        ends = "; ".join(
            f"{100.0 * share:.0f} % {name}, {c.amplitude:.3g}"
            for share, name, c in explored.ends[:5]
            if c and share > 0.005
        )
        cells.append((
            n.beta, n.sigma, predicted.amplitude if predicted else "–",
            2.0 * math.pi / predicted.omega if predicted else "–",
            ends, f"{100.0 * _share_met(n, explored):.0f} %", explored.largest_cycle,
        ))  # fmt: skip
    header = (
        "β",
        "σ",
        "M predicted",
        "periods",
        "starts end in (share, periods of a swing, M)",
        "within 15 %",
        "largest M",
    )
    return Table(
        header, cells, "Prediction, D(M) whole, beside exact simulation of starts up to 10 ticks; μ = 5, region B."
    )


def _share_met(n: Dimensionless, explored: Explored) -> float:
    predicted = predicted_cycle(n)
    return 0.0 if predicted is None else within(explored.cycles, predicted.amplitude, AMPLITUDE_TOLERANCE)


def _met(rows: list[tuple[Dimensionless, Explored]]) -> Comparison:
    shares = [_share_met(*row) for row in rows]
    mean = sum(shares) / len(shares)
    return Comparison(
        "starts that end within 15 % of the describing function's amplitude", "paper, Sec. VII", "one cycle, all",
        f"{100.0 * mean:.0f} %, at single points {100.0 * min(shares):.0f} to {100.0 * max(shares):.0f} %", mean > 0.95,
        note="below one tick the loop locks to one of several whole numbers of periods, and above one tick there are more",
    )  # fmt: skip


def _comparisons(omega: float) -> list[Comparison]:
    w = np.linspace(0.05, math.pi - 1e-6, 2000)
    sigma, amplitude = small_sigma(0.0, w, MU, TAU_L), small_amplitude(w, MU, TAU_L)
    foot = math.sin(TAU_L * omega) / omega
    exact, series = float(large_sigma(0.0, 5.0, MU, TAU_L)), float(large_sigma_series(0.0, 5.0, MU, TAU_L))
    bound = float(stability_sigma(0.0, MU, TAU_L))
    one = float(large_sigma_series(0.0, 1.0, MU, TAU_L))
    return [
        compare("largest σ of a small oscillation", "paper, Sec. VII-C: ½", 0.5, float(sigma.max()), 1e-6),
        compare("its frequency", "paper: π/(2τ_L)", math.pi / (2.0 * TAU_L), float(w[sigma.argmax()]), 1e-3, "rad/period"),
        Comparison(
            "σ and ω as M grows", "paper, Sec. VII-C", "decrease",
            "decrease" if np.all(np.diff(amplitude) < 0.0) and np.all(np.diff(sigma) > 0.0) else "do not",
            bool(np.all(np.diff(amplitude) < 0.0) and np.all(np.diff(sigma) > 0.0)),
        ),
        compare("ω of large oscillations by (71)", "paper, eq. 73", large_frequency_series(MU, TAU_L), omega, 0.001),
        compare(
            "σ of M = 5 at β = 0 by (72)", "paper, eq. 74", series, exact, 0.02 * series, note="a series, good to 2 % here"
        ),
        compare(
            "β where (72) meets σ = 0", "paper, Sec. VII-D: ½ + τ_D", TAU_L, foot, 0.01, note="exact for the series (74)"
        ),
        compare(
            "least σ at β = 0 for stability above one tick", "paper, eq. 75", bound, one, 0.03 * bound,
            note="(75) is (74) at M = 1 for μ ≫ τ_L²/2",
        ),
    ]  # fmt: skip


def _small(axes: Axes) -> None:
    beta = np.linspace(0.0, _BETA_SMALL, 400)
    colours = _colours(len(OMEGAS))
    for omega, colour in zip(OMEGAS, colours, strict=True):
        sigma, M = small_sigma(beta, omega, MU, TAU_L), float(small_amplitude(omega, MU, TAU_L))
        axes.plot(beta, sigma, color=colour, lw=1.6, label=f"M = {M:.2g}\nω = {omega:g}")
    axes.axhline(0.5, color=INK, lw=0.9)
    axes.axvline(TAU_L, color=GREY, lw=0.9, ls=":")
    axes.set_xlim(0.0, _BETA_SMALL)
    axes.set_ylim(0.0, 0.56)
    axes.set_title("(a) small oscillations, stable: M (ticks), ω (rad/period)")
    _axes(axes)
    axes.legend(**_BESIDE)


def _large(axes: Axes) -> None:
    beta = np.linspace(0.0, _BETA_LARGE, 300)
    for M, colour in zip(AMPLITUDES, _colours(len(AMPLITUDES)), strict=True):
        axes.plot(beta, large_sigma(beta, M, MU, TAU_L), color=colour, lw=1.6, label=f"M = {M:g}")
        gain = float(encoder_gain(M))
        omega = float(frequency(gain, MU, TAU_L))
        whole = np.pi * M / 4.0 * (gain * np.sin(TAU_L * omega) - beta * omega)
        axes.plot(beta, whole, color=colour, lw=1.0, ls="--")
    axes.axhline(0.5, color=INK, lw=0.9)
    axes.axvline(TAU_L, color=GREY, lw=0.9, ls=":")
    axes.set_xlim(0.0, _BETA_LARGE)
    axes.set_ylim(0.0, 3.6)
    omega = float(frequency(1.0, MU, TAU_L))
    axes.set_title(f"(b) large oscillations, unstable: M (ticks), all at ω = {omega:.3f}")
    _axes(axes)
    axes.legend(**_BESIDE)


def _axes(axes: Axes) -> None:
    axes.set_xlabel(r"viscous friction $\beta$")
    axes.set_ylabel(r"Coulomb friction $\sigma$")


def _colours(count: int) -> Any:
    from matplotlib import colormaps

    return colormaps["viridis"](np.linspace(0.0, 0.85, count))
