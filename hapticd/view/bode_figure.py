"""The Bode plot of a run: the device on the left, the rendered impedance on the right."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.figures.style import BLUE, GREY, INK, ORANGE, style
from hapticd.view._figure import RunFigure
from hapticd.view.bode import SEEN

if TYPE_CHECKING:
    from hapticd.view.bode import Bode, Curve, FloatArray

_THEORY = {"color": GREY, "lw": 1.0, "ls": "--", "label": "linear theory"}
_SIMULATED = {"color": ORANGE, "lw": 4.0, "alpha": 0.5, "label": "model, simulated with this excitation"}
_MEASURED = {"color": BLUE, "lw": 1.8, "label": f"measured (thin: coherence below {SEEN:g})"}
_UNSURE = {"color": BLUE, "lw": 0.7, "alpha": 0.4}


def bode_figure(found: Bode) -> RunFigure:
    """Magnitude, phase and coherence of both over frequency."""
    with style():
        figure = RunFigure(figsize=(11.0, 8.0), layout="constrained")
        axes = figure.subplots(3, 2, sharex=True, height_ratios=(3, 2, 1.2))
        for column, curve in enumerate((found.device, found.impedance)):
            _draw(axes[:, column], found.hz, curve)
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower right", ncols=3)
        figure.suptitle(found.name, x=0.01, ha="left", fontsize=12)
        figure.draw_without_rendering()
    return figure


def _draw(axes: Any, hz: FloatArray, curve: Curve) -> None:
    size, phase, coherent = axes
    size.set_title(f"{curve.title} ({curve.unit})")
    sure = np.where(curve.coherence >= SEEN, curve.measured, np.nan)
    for values, look in (
        (curve.theory, _THEORY),
        (curve.simulated, _SIMULATED),
        (curve.measured, _UNSURE),
        (sure, _MEASURED),
    ):
        if values is not None:
            size.loglog(hz, np.abs(values), **look)
            phase.semilogx(hz, np.degrees(np.angle(values)), **look)
    coherent.semilogx(hz, curve.coherence, color=INK, lw=1.0)
    coherent.axhline(SEEN, color=GREY, lw=0.7, ls=":")
    phase.set_yticks(range(-180, 181, 90))
    phase.set_ylim(-190, 190)
    coherent.set_ylim(0.0, 1.05)
    size.set_ylabel("magnitude")
    phase.set_ylabel("phase (°)")
    coherent.set_ylabel("coherence")
    coherent.set_xlabel("frequency (Hz)")
    for axis in axes:
        axis.grid(visible=True, which="major", color="#e2e2e2", lw=0.6)
