"""The measured lateness as a figure: how many ticks came later than a given time, one curve a rate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hapticd.figures.files import save_figure
from hapticd.figures.style import new_figure, style
from hapticd.servo.timing import bucket_edges

if TYPE_CHECKING:
    from hapticd.doctor.latency import LatencyResult


def write_figure(result: LatencyResult, path: Path) -> None:
    """Write the figure; the format follows the file's name.

    Raises:
        ValueError: the name has no extension that matplotlib knows.
    """
    with style():
        figure = new_figure(8.0, 4.4)
        axis = figure.subplots()
        edges = bucket_edges()[1:] * 1e-3
        for rate in result.rates:
            total = rate.histogram.sum()
            if total == 0:
                continue
            later = 1.0 - np.cumsum(rate.histogram) / total
            shown = later > 0
            (line,) = axis.plot(edges[shown], later[shown], lw=1.3, label=f"{rate.rate_hz:g} Hz")
            axis.axvline(1e6 / rate.rate_hz, color=line.get_color(), lw=0.8, ls=":")
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlabel("late by more than, µs (dotted: the period)")
        axis.set_ylabel("share of the ticks")
        axis.set_title(f"Lateness of the servo loop, driver {result.driver}")
        axis.legend()
        save_figure(figure, path, dpi=150)
