"""One look for all figures: light paper, few inks, one colour for each region."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hapticd.figures.files import naming

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK: Final = "#1b1b1b"
GREY: Final = "#8c8c8c"
RED: Final = "#8a1c12"
GREEN: Final = "#2e7d32"
BLUE: Final = "#0b5fa5"
ORANGE: Final = "#c7761b"

STABLE, LOCAL, BUZZ, UNSTABLE = "#cfe8cf", "#e4f2d5", "#fdebc8", "#f6d0cc"

#: Region → its colour.
REGION: Final = {
    "A": STABLE,
    "B": BUZZ,
    "C": UNSTABLE,
    "D": UNSTABLE,
    "E": LOCAL,
    "F1": STABLE,
    "F2": LOCAL,
}

_RC: Final[dict[str, Any]] = {
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#555555",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "mathtext.fontset": "dejavusans",
    "svg.hashsalt": "hapticd",
    "hatch.linewidth": 0.6,
}
_DPI: Final = 150


def style() -> Any:
    """Context in which figures are made and saved."""
    from matplotlib import rc_context

    return rc_context(_RC)


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of so many inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def save(figure: Figure, stem: Path) -> None:
    """Write ``stem.png`` and ``stem.svg``, without dates, so that the same numbers give the same files."""
    with naming(stem):
        figure.savefig(stem.with_suffix(".png"), dpi=_DPI, metadata={"Software": None})
        figure.savefig(stem.with_suffix(".svg"), dpi=_DPI, metadata={"Date": None, "Creator": None})


def prefixed(largest: float, unit: str) -> tuple[float, str]:
    """A factor and a unit with a prefix in which the numbers of an axis are short."""
    for factor, prefix in ((1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n")):
        if largest >= factor:
            return factor, prefix + unit
    return 1e-12, "p" + unit
