"""The figures of the gap report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.ticker import NullFormatter

from hapticd.reproduce.style import BLUE, GREY, ORANGE, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hapticd.gap.result import GapResult, Step
    from hapticd.gap.traces import Trace

_WIDTH: Final = 9.0
_BINS: Final = 120
_DECADE: Final = 15.0
"""Ranges beyond this have labels at powers of ten only."""


def _plain(value: float, _: object) -> str:
    return f"{value:g}"


def gap_over_time(traces: Sequence[Trace]) -> Figure:
    """The held-out gap of every window, before and after, and its distribution."""
    figure = new_figure(_WIDTH, 2.6 * max(1, len(traces)))
    axes = figure.subplots(max(1, len(traces)), 2, squeeze=False, width_ratios=(3, 1))
    top = max((float(np.quantile(trace.before, 0.995)) for trace in traces), default=2.0)
    bins = np.geomspace(0.2, max(top, 2.0), 60)
    for (over_time, spread), trace in zip(axes, traces, strict=False):
        for values, colour, label in ((trace.before, ORANGE, "before"), (trace.after, BLUE, "after")):
            time_s, level = _thinned(trace.time_s, values)
            over_time.plot(time_s, level, color=colour, lw=1.0, label=label)
            spread.hist(values, bins=bins.tolist(), color=colour, alpha=0.6, orientation="horizontal")
        for axis in (over_time, spread):
            axis.axhline(1.0, color=GREY, lw=1.0, ls="--")
            axis.set_yscale("log")
            axis.set_ylim(bins[0], bins[-1])
            axis.yaxis.set_major_formatter(_plain)
            axis.yaxis.set_minor_formatter(NullFormatter() if bins[-1] / bins[0] > _DECADE else _plain)
        over_time.set_title(
            f"{trace.name}: prediction error over noise, each window predicted by a model not fitted to it"
        )
        over_time.set_xlabel("s")
        spread.set_xlabel("windows")
    if traces:
        axes[0, 0].legend(ncols=2)
    return figure


def _thinned(time_s: Any, values: Any) -> tuple[Any, Any]:
    """RMS over stretches, so that a long run stays legible."""
    parts = min(_BINS, len(values))
    rms = [float(np.sqrt(np.mean(np.square(part)))) for part in np.array_split(values, parts)]
    return [float(np.mean(part)) for part in np.array_split(time_s, parts)], rms


def excerpts(trace: Trace, is_linear: bool) -> Figure:
    """The windows that gained most, in full."""
    shown = trace.excerpts
    figure = new_figure(_WIDTH, 2.7)
    axes = figure.subplots(1, max(1, len(shown)), squeeze=False)[0]
    scale, unit = (1e6, "µm") if is_linear else (1e3, "mrad")
    for axis, one in zip(axes, shown, strict=False):
        axis.plot(one.time_s * 1e3, one.observed * scale, ".", color=GREY, ms=3.5, label="measured")
        axis.plot(one.time_s * 1e3, one.before * scale, color=ORANGE, lw=1.2, label="model as given")
        axis.plot(one.time_s * 1e3, one.after * scale, color=BLUE, lw=1.2, label="improved model")
        axis.set_title(f"at {one.start_s:.2f} s")
        axis.set_xlabel("ms")
    axes[0].set_ylabel(unit)
    axes[0].legend()
    return figure


def where(entries: Sequence[Mapping[str, Any]]) -> Figure:
    """What share of the disagreement each coordinate accounts for."""
    shown = sorted(entries, key=lambda entry: float(entry["share"]))
    figure = new_figure(_WIDTH, 0.6 + 0.32 * len(shown))
    axis = figure.subplots()
    axis.barh([_label(entry) for entry in shown], [100.0 * float(entry["share"]) for entry in shown], color=ORANGE)
    axis.set_xlabel("% of the disagreement")
    return figure


def _label(entry: Mapping[str, Any]) -> str:
    low, high = ("" if end is None else f"{end:.3g}" for end in entry["range"])
    ends = f"{low} … {high}" if low and high else f"above {low}" if low else f"below {high}" if high else "anywhere"
    return f"{entry['coordinate']} {ends} {entry.get('unit', '')}".rstrip()


def ranking(step: Step) -> Figure:
    """The candidates of one round: gap that each leaves."""
    shown = sorted(step.ranking, key=lambda one: one.gap, reverse=True)
    figure = new_figure(_WIDTH, 0.7 + 0.24 * len(shown))
    axis = figure.subplots()
    tied = {step.effect, *step.indistinguishable_from}
    axis.barh(
        [one.effect for one in shown],
        [one.gap for one in shown],
        color=[BLUE if one.effect in tied else GREY for one in shown],
    )
    axis.axvline(step.gap_before, color=ORANGE, lw=1.4)
    axis.axvline(1.0, color=GREY, lw=1.0, ls="--")
    axis.set_xlabel("held-out gap with this effect (orange: without, dashed: noise)")
    return figure


def all_figures(result: GapResult, is_linear: bool) -> dict[str, Figure]:
    """Name to figure, in the order of the report."""
    figures = {"gap": gap_over_time(result.traces)}
    if result.where:
        figures["where"] = where(result.where)
    if result.traces and result.traces[0].excerpts:
        figures["windows"] = excerpts(result.traces[0], is_linear)
    figures |= {f"ranking-{number}": ranking(step) for number, step in enumerate(result.steps, 1) if step.ranking}
    return figures
