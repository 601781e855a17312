"""The figure of one or two runs: trace, phase plane, spectrum, energy, lateness, difference."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.figure import Figure

from hapticd.figures.style import BLUE, GREY, INK, ORANGE, RED, style
from hapticd.view._compare import Difference, difference

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.view.signals import Signals

_POINTS: Final = 20_000
"""Most points of a line; a longer run is decimated."""
_COLOURS: Final = (BLUE, ORANGE)
_BY_RUN: Final = ("trace", "phase", "spectrum", "lateness")
"""Panels with a colour for each run."""
_EVENTS: Final = 12
"""Most event marks; more would hide the trace."""

Draw = Callable[[Any, "Sequence[Signals]"], None]


class RunFigure(Figure):
    """A figure that a notebook shows without pyplot."""

    def _repr_png_(self) -> bytes:
        picture = io.BytesIO()
        self.savefig(picture, format="png", dpi=90)
        return picture.getvalue()


def run_figure(
    first: Signals, second: Signals | None = None, *, only: Sequence[str] | None = None, title: str | None = None
) -> RunFigure:
    """Plot one run, or two runs and their difference.

    Args:
        first: the run. second: another run, plotted over it.
        only: some of `PANELS`; all that apply by default.
        title: of the figure; by default the names of the files.

    Raises:
            ValueError: an unknown panel.
            RunFileError: the difference is requested, and the runs have no time or unit in common.
    """
    both = (first,) if second is None else (first, second)
    names = list(only) if only else [name for name in PANELS if name != "difference" or second is not None]
    if unknown := [name for name in names if name not in PANELS]:
        raise ValueError(f"no panel {unknown[0]!r}; there are {', '.join(PANELS)}")
    if "difference" in names and second is None:
        raise ValueError("the panel 'difference' needs a second run")
    with style():
        figure = RunFigure(figsize=(11.0, 0.8 + 2.9 * -(-(len(names) + ("trace" in names)) // 2)), layout="constrained")
        axes: dict[str, Any] = figure.subplot_mosaic(_mosaic(names))
        for name in names:
            PANELS[name](axes[name], both)
        names_of = " and ".join(each.run.path.name for each in both)
        figure.suptitle(title or names_of, x=0.01, ha="left", fontsize=12)
        if second is not None:
            drawn = {line.get_color() for name in names if name in _BY_RUN for line in axes[name].lines}
            named = [(colour, each.run.path.name) for colour, each in zip(_COLOURS, both, strict=True)]
            if handles := [_line(colour, name) for colour, name in named if colour in drawn]:
                # below the panels: above them, two long names would overlap the title
                figure.legend(handles=handles, loc="outside lower right", ncols=2)
        # also for parts that are drawn later
        figure.draw_without_rendering()
    return figure


def _line(colour: str, label: str) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], color=colour, lw=1.6, label=label)


def _mosaic(names: Sequence[str]) -> list[list[str]]:
    """Two panels per row; the trace has its own row, and the last panel fills its row."""
    rows = [["trace", "trace"]] if "trace" in names else []
    rest = [name for name in names if name != "trace"]
    rows += [rest[at : at + 2] if at + 1 < len(rest) else [rest[at]] * 2 for at in range(0, len(rest), 2)]
    return rows


def _thin(size: int) -> slice:
    return slice(None, None, max(1, size // _POINTS))


def _trace(axis: Any, both: Sequence[Signals]) -> None:
    first = both[0]
    axis.set_title("Position (line) and command (dots)" if first.current.size < _POINTS else "Position and command")
    right = axis.twinx()
    right.spines["right"].set_visible(True)
    for colour, each in zip(_COLOURS, both, strict=False):
        thin = _thin(each.time_s.size)
        axis.plot(each.time_s[thin], each.position[thin], color=colour, lw=1.2, zorder=3)
        right.plot(each.time_s[thin], each.current[thin], ".", color=colour, ms=1.2, alpha=0.35, zorder=1)
    axis.set_zorder(right.get_zorder() + 1)
    axis.patch.set_visible(False)
    for when, name in first.events[:_EVENTS]:
        axis.axvline(when, color=RED if name == "fault" else GREY, lw=0.9, ls=":")
        axis.annotate(
            name, (when, 1.0), xycoords=("data", "axes fraction"), fontsize=7.5, rotation=90, va="top", ha="right"
        )
    axis.set_xlabel("time since the spring was rendered (s)")
    axis.set_ylabel(f"position ({first.position_unit})")
    right.set_ylabel(f"command ({first.current_unit})")
    axis.margins(x=0.01)


def _phase(axis: Any, both: Sequence[Signals]) -> None:
    first = both[0]
    axis.set_title("Phase plane")
    for colour, each in zip(_COLOURS, both, strict=False):
        shown = each.running if each.running.any() else np.ones(each.time_s.size, dtype=bool)
        position, velocity = each.position[shown], each.velocity[shown]
        thin = _thin(position.size)
        axis.plot(position[thin], velocity[thin], color=colour, lw=0.9, alpha=0.85)
        axis.plot(position[:1], velocity[:1], "o", color=colour, ms=5)
    if first.tick is not None:
        axis.axvspan(-first.tick, first.tick, color="#000000", alpha=0.06, lw=0)
    axis.set_xlabel(f"position ({first.position_unit}); grey: ± one coarse tick; dot: start")
    axis.set_ylabel(f"velocity, estimated ({first.position_unit}/s)")


def _spectrum(axis: Any, both: Sequence[Signals]) -> None:
    axis.set_title("Amplitude spectral density of the position")
    found = [(colour, each.spectrum(each.position)) for colour, each in zip(_COLOURS, both, strict=False)]
    drawn = [(colour, spectrum) for colour, spectrum in found if spectrum is not None and spectrum.density.any()]
    if not drawn:
        _nothing(axis, "too short, or nothing moved")
        return
    for line, (colour, spectrum) in enumerate(drawn):
        axis.plot(spectrum.hz, spectrum.density, color=colour, lw=1.1)
        top = float(spectrum.density.max())
        axis.plot(spectrum.peak_hz, top, "v", color=colour, ms=6)
        axis.annotate(
            f"{spectrum.peak_hz:.4g} Hz",
            (spectrum.peak_hz, top),
            xytext=(7, -2 - 11 * line),
            textcoords="offset points",
            fontsize=8.5,
            color=colour,
        )
    axis.set(xscale="log", yscale="log", xlabel="frequency (Hz)")
    axis.set_ylabel(f"{both[0].position_unit}/√Hz")


def _energy(axis: Any, both: Sequence[Signals]) -> None:
    axis.set_title("Energy since the last start, estimated through the model")
    known = [(line, each) for line, each in zip(("-", "--"), both, strict=False) if each.energy is not None]
    if not known:
        _nothing(axis, both[0].why_no_energy or "no ledger")
        return
    for line, each in known:
        assert each.energy is not None
        energies, time_s = each.energy.energies, each.energy.time_s
        thin = _thin(time_s.size)
        time_s = time_s[thin] - time_s[0]
        for values, colour, label in (
            (energies["stored"], INK, "stored"),
            (energies["viscous"] + energies["coulomb"], BLUE, "dissipated"),
            (energies["generated"], RED, "generated"),
            (each.energy.unexplained, GREY, "unexplained"),
        ):
            axis.plot(
                time_s, 1e3 * values[thin], line, color=colour, lw=1.3, label=label if each is known[0][1] else None
            )
    axis.set_xlabel("time since the last start (s)" + ("; dashed: second run" if len(known) > 1 else ""))
    axis.set_ylabel("energy (mJ)")
    axis.margins(x=0.01)
    axis.legend(loc="best")


def _lateness(axis: Any, both: Sequence[Signals]) -> None:
    axis.set_title("Lateness of the wake (line) and duration of the tick (dotted)")
    known = [(colour, each) for colour, each in zip(_COLOURS, both, strict=False) if each.late_s is not None]
    if not known:
        _nothing(axis, "no lateness: virtual time, or not recorded")
        return
    period = 1e6 * known[0][1].period_s
    for colour, each in known:
        for seconds, line in ((each.late_s, "-"), (each.exec_s, ":")):
            if seconds is not None:
                axis.plot(*_exceeded(1e6 * seconds), line, color=colour, lw=1.3)
    axis.axvline(period, color=RED, lw=0.9, ls="--")
    axis.annotate(" one period", (period, 0.97), xycoords=("data", "axes fraction"), color=RED, fontsize=8.5, va="top")
    missed = ", ".join(str(each.missed) for _, each in known)
    axis.set(xscale="log", yscale="log", ylabel="share of ticks above it")
    axis.set_xlabel(f"µs (skipped before {missed} ticks)")


def _exceeded(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sorted values, and the share of values that are at least as large."""
    ordered = np.sort(np.maximum(values, 1e-3))
    share = 1.0 - np.arange(ordered.size) / ordered.size
    rough = max(1, ordered.size // _POINTS)
    keep = np.unique(
        np.concatenate([np.arange(0, ordered.size, rough), np.arange(max(0, ordered.size - 500), ordered.size)])
    )
    return ordered[keep], share[keep]


def _difference(axis: Any, both: Sequence[Signals]) -> None:
    found: Difference = difference(both[0], both[1])
    thin = _thin(found.time_s.size)
    sizes = found.document["position"]
    axis.set_title(f"Second less first: position RMS {sizes['rms']:.3g} {found.position_unit}")
    right = axis.twinx()
    right.spines["right"].set_visible(True)
    dots = right.plot(found.time_s[thin], found.current[thin], ".", color=GREY, ms=1.5, alpha=0.5, label="command")
    right.set_ylabel(f"command ({found.current_unit})")
    drawn = axis.plot(found.time_s[thin], found.position[thin], color=INK, lw=1.1, label="position") + dots
    if (tick := both[0].tick) is not None:
        drawn.append(axis.axhspan(-tick, tick, color="#000000", alpha=0.06, lw=0, label="± one coarse tick"))
    axis.set_zorder(right.get_zorder() + 1)
    axis.patch.set_visible(False)
    axis.set_xlabel("time since the spring was rendered (s)")
    axis.set_ylabel(f"position ({found.position_unit})")
    axis.margins(x=0.01)
    axis.legend(handles=drawn, loc="best", markerscale=4.0, frameon=True, framealpha=0.85, edgecolor="none")


def _nothing(axis: Any, why: str) -> None:
    axis.text(0.5, 0.5, why, transform=axis.transAxes, ha="center", va="center", color=GREY, wrap=True)
    axis.set(xticks=[], yticks=[])


PANELS: Final[dict[str, Draw]] = {
    "trace": _trace,
    "phase": _phase,
    "spectrum": _spectrum,
    "energy": _energy,
    "lateness": _lateness,
    "difference": _difference,
}
"""Name of each panel to its drawing function."""
