"""Fig. 9: displacement/force diagrams of five springs; Sec. VI checked: their energy, the counterexample to (46), (54)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapticd.figures.style import GREY, INK, RED, new_figure
from hapticd.reproduce.items import Comparison, Item, Progress, Table, compare
from hapticd.reproduce.spring_diagrams import SPRINGS, SpringDiagrams, press_and_release, spring_diagrams
from hapticd.stability.bounds import check_bounds
from hapticd.stability.ledger import ledger
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.storage import rho

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DEPTH, PERIODS, TAU_D = 5.6, 12, 0.6
#: One period in region A whose energy rises: operating point, ξ(h), ξ̇(h).
COUNTEREXAMPLE: Final = (Dimensionless(100.0, 0.51, 0.51), 0.99, 0.5)
#: A motion with delay for (54): ξ(h), ξ(l), ξ(τ₁).
MOTION: Final = (0.3, 2.85, 5.4)
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
    checks, numbers = _comparisons(diagrams)
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
            "Bound (46), and with it (47) and (58), does not hold of the energy (35): (45) is attained only where its "
            "maximum is. The check below is small enough for a pocket calculator: region A, one period, and H_T rises. Of "
            "½μξ̇² + ½ξ² the same bounds hold, and with them (12) and (19).",
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
    """The closed curve of a motion in the diagram, with its area filled."""
    axes.fill(diagrams.xi, -diagrams.force[spring], label=_NAMES[spring], **look)


def _comparisons(diagrams: SpringDiagrams) -> tuple[list[Comparison], dict[str, Any]]:
    """The comparisons of Fig. 9, and their numbers."""
    numbers, xi, xi_dot = COUNTEREXAMPLE
    account = ledger(numbers, xi, xi_dot, 1)
    before, after = (float(energy) for energy in account.stored)
    bounds = check_bounds(account)
    excess = float(bounds.excess[0])
    linear = [
        0.5 * (numbers.mu * float(v) ** 2 + float(x) ** 2) for x, v in zip(account.xi, account.xi_dot, strict=True)
    ]
    printed, corrected, exact = eq_54(*MOTION)
    digital, sampled, delayed = (diagrams.generated(name) for name in ("digital", "sampled", "delayed"))
    found = [
        compare("energy made by the physical spring", "paper, Sec. VI", 0.0, diagrams.generated("physical"), 1e-12, "KΔ²"),
        compare("energy made by the quantised spring", "paper, Sec. VI", 0.0, diagrams.generated("quantised"), 1e-12, "KΔ²"),
        Comparison("energy made by sampling", "paper, eq. 43", "always positive", f"{sampled:.4g} KΔ²", sampled > 0.0),
        Comparison(
            "delay adds to it", "paper, Sec. VI", "likely", f"{digital:.4g} → {delayed:.4g} KΔ²", delayed > digital
        ),
        compare("H_T before: μ = 100, β = σ = 0.51, ξ = 0.99, ξ̇ = 0.5", "independent simulation", 12.995, before, 5e-4),
        compare("H_T one period later", "independent simulation", 13.103, after, 5e-4),
        Comparison(
            "stored energy in that period, in region A", "paper, eq. 12, 51", "decreases",
            f"rises by {after - before:.4f} KΔ²", after <= before,
            note="of H_T (35): bound (46) fails just past an encoder edge",
        ),
        Comparison(
            "½μξ̇² + ½ξ² in that period", "theorem 1", "decreases", f"falls by {linear[0] - linear[1]:.4f} KΔ²",
            linear[1] < linear[0], note="the energy for which (12) is a theorem",
        ),
        Comparison(
            "largest E_g less bound (47) in it", "paper, eq. 47", "at most 0", excess, excess <= 1e-9, unit="KΔ²",
            note="(47) bounds what ½μξ̇² + ½ξ² receives, not what (35) does",
        ),
        compare(
            "E_gq of ξ(h) = 0.3, ξ(l) = 2.85, ξ(τ₁) = 5.4: (54), signs corrected", "quadrature", exact, corrected, 1e-6,
            "KΔ²",
        ),
        compare(
            "the same E_gq", "paper, eq. 54 as printed", printed, corrected, 1e-6, "KΔ²",
            "the last two terms of (54) are printed with the wrong sign, as (33) shows",
        ),
    ]  # fmt: skip
    return found, {
        "generated": {name: diagrams.generated(name) for name in diagrams.work},
        "counterexample": {"before": before, "after": after, "excess": excess, "linear": linear},
        "eq_54": {"printed": printed, "corrected": corrected, "quadrature": exact},
    }


def eq_54(xi_h: float, xi_l: float, xi_end: float, points: int = 1_000_000) -> tuple[float, float, float]:
    """E_gq of (54) as printed, with corrected signs, and by the midpoint rule from ∫(ρ(h) − ρ(χ))dχ."""
    rho_h, rho_l, rho_end = (float(rho(xi)) for xi in (xi_h, xi_l, xi_end))
    ticks = np.floor(xi_end) - np.floor(xi_l)
    first = float((rho_h - 0.5) * ticks)
    rest = 0.5 * (rho_end - rho_l) ** 2 + (rho_l - rho_h) * (rho_end - rho_l)
    middles = xi_l + (xi_end - xi_l) * (np.arange(points) + 0.5) / points
    return first + rest, first - rest, float(np.mean(rho_h - rho(middles)) * (xi_end - xi_l))
