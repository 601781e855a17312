"""The suite's report as one HTML file: verdict, table, traces on the device over simulated ones, the delay's histogram."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from hapticd.figures.files import atomic_write
from hapticd.figures.markup import STYLE
from hapticd.figures.style import BLUE, GREY, ORANGE, new_figure, style
from hapticd.hil.suite import CaseResult, SuiteResult
from hapticd.hil.text import suite_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE: Final = "report.html"


def write_page(result: SuiteResult, folder: Path) -> Path:
    """Write the report into a folder and return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / PAGE
    with atomic_write(path) as part:
        part.write_text(_page(result))
    return path


def _page(result: SuiteResult) -> str:
    verdict = "does what the simulation says" if result.agrees else "differs from the simulation"
    with style():
        traces, delays = _embed(_traces(result.cases)), _embed(_delays(result)) if len(result.latency_s) else ""
    declared = 1e6 * result.declared_s
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>Hardware in the loop: {escape(result.driver)}</title><style>{STYLE}</style></head><body>"
        f"<h1>The daemon on {escape(result.driver)} {verdict}</h1>"
        '<p class="soft">Simulated hardware in a process of its own, the daemon as a user runs it, and the same loop in '
        f'virtual time with the declared delay.</p><div class="scroll"><pre>{escape(suite_text(result))}</pre></div>'
        f"<figure>{traces}<figcaption>Position from the spring's origin and commanded current: on the device, and simulated "
        "from the deflection that was really achieved.</figcaption></figure>"
        f"<figure>{delays}<figcaption>From the latched encoder sample to the arrival of the command computed from it, in "
        f"the device's own log. The driver declares {declared:.0f} µs.</figcaption></figure></body></html>\n"
    )


def _embed(figure: Figure) -> str:
    image = io.StringIO()
    figure.savefig(image, format="svg")
    data = base64.b64encode(image.getvalue().encode()).decode()
    return f'<img alt="" src="data:image/svg+xml;base64,{data}">'


def _traces(cases: Sequence[CaseResult]) -> Figure:
    figure = new_figure(9.5, 2.4 * max(1, len(cases)))
    axes = figure.subplots(max(1, len(cases)), 2, squeeze=False)
    for row, case in zip(axes, cases, strict=False):
        simulated, measured = case.comparison.simulated, case.comparison.measured
        for axis, name, unit in ((row[0], "ticks", "coarse ticks"), (row[1], "current", "A")):
            axis.plot(simulated.time_s, getattr(simulated, name), color=GREY, lw=2.4, label="simulated")
            axis.plot(measured.time_s, getattr(measured, name), color=BLUE, lw=0.9, label="on the device")
            axis.set_ylabel(unit)
            axis.set_xlim(0, measured.time_s[-1] if len(measured.time_s) else 1)
        reach = np.abs(measured.ticks).max(initial=1.0) * 1.15
        row[0].set_ylim(-reach, reach)
        row[0].set_title(f"{case.name}: {case.what}")
    axes[0, 0].legend()
    for axis in axes[-1]:
        axis.set_xlabel("s")
    return figure


def _delays(result: SuiteResult) -> Figure:
    figure = new_figure(9.5, 2.6)
    axis = figure.subplots()
    delays = result.latency_s * 1e6
    axis.hist(delays, bins=np.geomspace(max(delays.min(), 1.0), delays.max() * 1.01, 80).tolist(), color=BLUE)
    axis.axvline(result.declared_s * 1e6, color=ORANGE, lw=1.5)
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_xlabel("µs from sample to current")
    axis.set_ylabel("commands")
    return figure
