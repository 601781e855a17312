"""Fig. 11: Nyquist plots of the loop without Coulomb friction, and the describing function of the encoder."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hapticd.figures.style import BLUE, GREY, INK, ORANGE, RED, new_figure
from hapticd.reproduce.items import Comparison, Item, Progress, Table, compare
from hapticd.stability.describing_function import LimitCycle, encoder_gain, encoder_gain_small, limit_cycles, nyquist
from hapticd.stability.numbers import Dimensionless

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MU, BETA = 5.0, 1.2
#: Loop delays τ_L and their colours; the zero-order hold alone is ½.
DELAYS = {0.0: GREY, 0.5: BLUE, 1.0: ORANGE}


def build(quick: bool, progress: Progress) -> Item:
    """Draw the figure."""
    cycles = {tau_l: limit_cycles(Dimensionless(MU, BETA, 0.0, tau_l - 0.5)) for tau_l in DELAYS if tau_l >= 0.5}
    figure = new_figure(10.0, 4.6)
    left, right = figure.subplots(1, 2)
    _nyquist(left, cycles)
    _gain(right)
    rows = [
        (tau_l, cycle.amplitude, cycle.omega, "stable" if cycle.stable else "unstable", _residual(tau_l, cycle))
        for tau_l, found in cycles.items()
        for cycle in found
    ]
    return Item(
        name="fig11",
        title="Fig. 11: Nyquist plots and the encoder's describing function",
        see=(
            f"(a) μ = {MU:g}, β = {BETA:g}, σ = 0. Without any delay the curve reaches the negative real axis at the origin "
            "only: infinite frequency, no amplitude. Half a period of delay, the zero-order hold alone, makes it cross "
            "−1/D(M) at a finite frequency: a limit cycle from quantisation, without Coulomb friction.",
            "(b) D(M) is 2/(πM) up to one tick, leaps at each whole tick, and tends to 1: ticks matter to small motions.",
        ),
        traps=(
            "−1/D(M) runs from the origin to −π/2 at one tick and back to −1 for large M, folded on the axis: a crossing "
            "beyond −1 has several amplitudes. The amplitudes in the table are solved with the whole D(M).",
        ),
        figure=figure,
        alt="Left, three Nyquist curves, two of which cross −1/D(M). Right, D(M), which falls and leaps at ticks.",
        tables=(
            Table(("τ_L", "amplitude M (ticks)", "ω (rad/period)", "cycle", "error of (62)"), rows, "Intersections (62)."),
        ),
        comparisons=_comparisons(cycles),
        numbers={
            "mu": MU, "beta": BETA,
            "cycles": [
                {"tau_l": tau_l, "amplitude": c.amplitude, "omega": c.omega, "stable": c.stable}
                for tau_l, found in cycles.items() for c in found
            ],
        },
    )  # fmt: skip


def _residual(tau_l: float, cycle: LimitCycle) -> float:
    curve = complex(nyquist(cycle.omega, MU, BETA, tau_l))
    return abs(curve + 1.0 / float(encoder_gain(cycle.amplitude)))


def _comparisons(cycles: dict[float, list[LimitCycle]]) -> list[Comparison]:
    M = np.linspace(0.01, 1.0, 500)
    gap = float(np.abs(encoder_gain(M) - encoder_gain_small(M)).max())
    first = [found[0] for found in cycles.values()]
    high = nyquist(np.array([1e4]), MU, BETA, 0.0)[0]
    return [
        compare("largest |D − D₁| for M ≤ 1", "paper, Fig. 11b: equal", 0.0, gap, 1e-12),
        compare("D(1)", "eq. 67: 2/π", 2.0 / math.pi, float(encoder_gain(1.0)), 1e-12),
        compare("D(50)", "paper, Sec. VII-B: tends to 1", 1.0, float(encoder_gain(50.0)), 0.01),
        Comparison(
            "limit cycles with delay", "paper, Fig. 11a", "finite ω, for τ_L > 0",
            "; ".join(f"ω = {c.omega:.3f}, M = {c.amplitude:.3f}" for c in first),
            all(c.stable and math.isfinite(c.omega) for c in first),
        ),
        compare("phase at ω = 10⁴ without delay", "paper: −π at infinite ω", -math.pi, -abs(np.angle(high)), 1e-3, "rad"),
    ]  # fmt: skip


def _nyquist(axes: Axes, cycles: dict[float, list[LimitCycle]]) -> None:
    omega = np.geomspace(0.12, 30.0, 4000)
    axes.plot([-math.pi / 2.0, 0.0], [0.0, 0.0], color=RED, lw=4, alpha=0.45, solid_capstyle="butt", label=r"$-1/D(M)$")
    for tau_l, color in DELAYS.items():
        curve = nyquist(omega, MU, BETA, tau_l)
        axes.plot(curve.real, curve.imag, color=color, lw=1.4, label=rf"$\tau_L$ = {tau_l:g}")
        for cycle in cycles.get(tau_l, ()):
            place = -1.0 / float(encoder_gain(cycle.amplitude))
            axes.plot(place, 0.0, "o", color=color, mec="white", ms=7, zorder=5)
    axes.axhline(0.0, color=INK, lw=0.6, zorder=0)
    axes.axvline(0.0, color=INK, lw=0.6, zorder=0)
    axes.set_xlim(-2.0, 0.4)
    axes.set_ylim(-1.0, 0.6)
    axes.set_xlabel("real part")
    axes.set_ylabel("imaginary part")
    axes.set_title(r"(a) $G(\omega)\,e^{-j\tau_L\omega}$ and $-1/D(M)$, $\sigma$ = 0")
    axes.legend(loc="lower right")


def _gain(axes: Axes) -> None:
    M = np.unique(np.concatenate((np.linspace(0.2, 6.0, 1200), np.arange(1, 7)[:, None].ravel() + 1e-6)))
    axes.plot(M, encoder_gain(M), color=INK, lw=1.5, label=r"$D(M)$")
    axes.plot(M, encoder_gain_small(M), color=BLUE, lw=1.2, ls="--", label=r"$D_1(M) = 2/(\pi M)$")
    axes.axhline(1.0, color=GREY, lw=0.8)
    axes.set_xlim(0.0, 6.0)
    axes.set_ylim(0.0, 2.5)
    axes.set_xlabel("amplitude $M$ (ticks)")
    axes.set_title("(b) describing function of the encoder")
    axes.legend(loc="upper right")
