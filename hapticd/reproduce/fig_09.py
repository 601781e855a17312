"""Fig. 9: displacement/force diagrams of five springs, and what Sec. VI says of their energy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.figures.style import GREY, INK, RED, new_figure
from hapticd.reproduce.energy import comparisons
from hapticd.reproduce.items import Item, Progress, Table
from hapticd.stability.spring_diagrams import SPRINGS, SpringDiagrams, press_and_release, spring_diagrams

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DEPTH, PERIODS, TAU_D = 5.6, 12, 0.6
_NAMES = {
    "physical": r"physical $\varphi_P$ (21)",
    "quantised": r"quantised $\varphi_Q$ (22)",
    "sampled": r"sampled $\varphi_Z$ (23)",
    "digital": r"digital $\varphi_C$ (24)",
    "delayed": r"delayed $\varphi_A$ (9)",
}


def build(quick: bool, progress: Progress) -> Item:
    """Draw the figure."""
    diagrams = spring_diagrams(press_and_release(DEPTH, float(PERIODS)), PERIODS, TAU_D)
    checks, numbers = comparisons(diagrams)
    rows = [(name, round(diagrams.work[name], 12), round(diagrams.generated(name), 12)) for name in SPRINGS]
    return Item(
        name="fig9",
        title="Fig. 9: displacement and force of a virtual spring",
        see=(
            f"One press to {DEPTH:g} ticks and back in {PERIODS} periods, seen by five springs; up is the force against the "
            "press. The physical and the quantised spring return on the line they came on: no energy is made. Sampling "
            "opens loops, run through so that the device gets more back than it gave; the area is the generated energy.",
            "Left, the digital loop is sometimes larger and sometimes smaller than the merely sampled one. Right, delay "
            "mostly widens the loops.",
        ),
        traps=(
            "Bound (46), and with it (47) and (58), does not hold: (45) is attained only where its maximum is. The check "
            "below is small enough for a pocket calculator: region A, one period, and the stored energy rises.",
            "(54): the last two terms have the opposite sign of the printed ones; the check compares both with quadrature.",
        ),
        figure=_draw(diagrams),
        alt="Two force over displacement diagrams with hysteresis loops along a staircase.",
        tables=(Table(("spring", "work on the device (KΔ²)", "generated (KΔ²)"), rows, "Energies of this press."),),
        comparisons=checks,
        numbers=numbers,
    )


def _draw(diagrams: SpringDiagrams) -> Any:
    figure = new_figure(10.0, 4.9)
    left, right = figure.subplots(1, 2, sharey=True)
    _loop(left, diagrams, "digital", facecolor="#d2d2d2", edgecolor=INK, lw=0.9)
    _loop(left, diagrams, "sampled", facecolor="none", edgecolor=RED, hatch="++", lw=1.0)
    order = np.argsort(diagrams.xi, kind="stable")
    left.plot(diagrams.xi[order], -diagrams.force["quantised"][order], color=INK, lw=1.6, label=_NAMES["quantised"])
    left.plot(
        diagrams.xi[order], -diagrams.force["physical"][order], color=INK, lw=1.1, ls="--", label=_NAMES["physical"]
    )
    _loop(right, diagrams, "digital", facecolor="#d2d2d2", edgecolor=INK, lw=0.9)
    _loop(right, diagrams, "delayed", facecolor="none", edgecolor=RED, hatch="++", lw=1.0)
    left.set_title("(a) sampling and quantisation")
    right.set_title(rf"(b) with delay, $\tau_D$ = {TAU_D:g}")
    for axes in (left, right):
        axes.set_xlabel(r"displacement $\xi$ (ticks)")
        axes.grid(color=GREY, alpha=0.25, lw=0.5)
        axes.legend(loc="upper left")
    left.set_ylabel(r"force against the press $-\varphi$ (ticks)")
    return figure


def _loop(axes: Axes, diagrams: SpringDiagrams, spring: str, **look: Any) -> None:
    """The closed way of a motion in the diagram, its area filled."""
    axes.fill(diagrams.xi, -diagrams.force[spring], label=_NAMES[spring], **look)
