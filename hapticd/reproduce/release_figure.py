"""Fig. 8 as a figure (operating point and critical line on the left, displacement on the right) and as a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from hapticd.figures.style import BLUE, GREY, INK, new_figure
from hapticd.reproduce.items import Table
from hapticd.reproduce.plane import draw_plane
from hapticd.reproduce.release import Release
from hapticd.stability.regions import region

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TITLES: Final = {
    "a": "region A: stops",
    "b": "region B: buzzes",
    "c": "region E: stops",
    "d": "region D: grows",
}
_MARKED_UP_TO: Final = 100
_INSET_PERIODS: Final = 150


def release_figure(runs: Sequence[Release]) -> Figure:
    """The figure, one row per run."""
    figure = new_figure(9.6, 10.0)
    grid = figure.subplots(len(runs), 2, gridspec_kw={"width_ratios": (1.0, 2.0)})
    for (left, right), run in zip(grid, runs, strict=True):
        draw_plane(left, run.numbers.mu, 0.0, run.xi_dot_max, 1.0, 2.0)
        left.plot(run.numbers.beta, run.numbers.sigma, "o", color=BLUE, ms=8, mec="white", zorder=5)
        left.set_title(f"({run.case.name})  " + rf"$\dot\xi_{{\max}}$ = {run.xi_dot_max:.2g}")
        _course(right, run)
        if run.case.name == "b":
            _inset(right, run)
    for left in grid[:-1, 0]:
        left.set_xlabel("")
    grid[-1, 1].set_xlabel("time (s)")
    return figure


def _course(axes: Axes, run: Release) -> None:
    shown = slice(0, run.case.shown)
    axes.axhline(0.0, color=GREY, lw=0.6)
    for tick in (-1.0, 1.0):
        axes.axhline(tick, color=GREY, lw=0.9, ls="--")
    marker = "." if run.case.shown <= _MARKED_UP_TO else None
    axes.plot(run.time_s[shown], run.xi[shown], color=INK, lw=1.1, marker=marker, ms=4)
    axes.set_ylabel(r"$x/\Delta$ (ticks)")
    axes.set_title(_TITLES[run.case.name])
    axes.margins(x=0.01)


def _inset(axes: Axes, run: Release) -> None:
    last = slice(-_INSET_PERIODS, None)
    axes.set_ylim(-3.5, 5.5)
    small = axes.inset_axes((0.42, 0.6, 0.56, 0.3))
    small.plot(run.time_s[last], run.xi[last] * run.case.decimation, color=BLUE, lw=1.0)
    small.set_title(f"the last {_INSET_PERIODS} of {run.case.periods} periods, in raw counts", fontsize=8.5)
    small.tick_params(labelsize=8)
    small.set_xticks([])


def release_table(runs: Sequence[Release]) -> Table:
    """The table of the same runs."""
    header = (
        "case",
        "rate (Hz)",
        "decimation",
        "release (ticks)",
        "μ",
        "β",
        "σ",
        "ξ̇_max",
        "region",
        "outcome",
        "moves for",
        "final (ticks)",
    )
    rows = []
    for run in runs:
        n, case = run.numbers, run.case
        rest = f"{run.rest_periods} periods" if run.rest_periods else "never"
        final = run.report["final"]["position_ticks"]
        rows.append((
            case.name, case.rate_hz, case.decimation, case.deflection, n.mu, n.beta, n.sigma, run.xi_dot_max,
            region(n, run.xi_dot_max), run.report["outcome"], rest, final if run.rest_periods else "–",
        ))  # fmt: skip
    return Table(header, rows)
