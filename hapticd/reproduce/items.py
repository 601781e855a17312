"""A reproduced table or figure of the paper: figure, tables, text, and the comparison with the paper's numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Takes the fraction of a builder's work that is done.
Progress = Callable[[float], None]
Cell = str | float | int

_RAISED: Final = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


@dataclass(frozen=True)
class Comparison:
    """Comparison of a source's number or statement with our result.

    Attributes:
        what: the quantity or statement.
        source: of `printed`.
        printed: the source's number, or its statement.
        ours: our number or result.
        agrees: whether they agree, a number within its tolerance.
        unit: of both numbers.
        note: why they differ, or a remark.
    """

    what: str
    source: str
    printed: float | str
    ours: float | str
    agrees: bool
    unit: str = ""
    note: str = ""

    @property
    def difference(self) -> float | None:
        """Ours minus printed; None for a statement."""
        if isinstance(self.printed, str) or isinstance(self.ours, str):
            return None
        return self.ours - self.printed

    @property
    def document(self) -> dict[str, Any]:
        """As JSON."""
        return {**asdict(self), "difference": self.difference}


def compare(
    what: str, source: str, printed: float, ours: float, tolerance: float, unit: str = "", note: str = ""
) -> Comparison:
    """Compare two numbers; they agree if they differ by at most an absolute tolerance."""
    return Comparison(what, source, printed, ours, abs(ours - printed) <= tolerance, unit, note)


@dataclass(frozen=True)
class Table:
    """A table of the page.

    Attributes:
        header: names of the columns.
        rows: cells as text, or numbers, which are shown to five digits.
        caption: a sentence above it.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""


@dataclass(frozen=True)
class Item:
    """One reproduced table or figure of the paper. All text is plain text.

    Attributes:
        name: ``table1`` … ``fig12``, also the stem of its files.
        title: heading.
        see: explanation of the figure.
        traps: errors and ambiguities of the paper's text or numbers, and how they are resolved.
        figure: the figure; None for a table.
        alt: description of the figure, for readers who cannot see it.
        tables: its numbers.
        comparisons: of the paper with our results.
        numbers: further numbers, as JSON data.
    """

    name: str
    title: str
    see: Sequence[str]
    traps: Sequence[str] = ()
    figure: Figure | None = None
    alt: str = ""
    tables: Sequence[Table] = ()
    comparisons: Sequence[Comparison] = ()
    numbers: dict[str, Any] = field(default_factory=dict)

    @property
    def document(self) -> dict[str, Any]:
        """As JSON."""
        return {
            "title": self.title,
            "comparisons": [comparison.document for comparison in self.comparisons],
            "numbers": self.numbers,
        }


def show(value: Cell) -> str:
    """A cell as text: numbers to five significant digits, with a true minus and powers of ten."""
    if isinstance(value, str):
        return value
    if not math.isfinite(value):
        return "∞" if value > 0.0 else "–"
    if float(value).is_integer() and abs(value) < 1e7:
        text = f"{value:.0f}"
    elif 1e-4 <= abs(value) < 1e6:
        text = f"{value:.5g}"
    else:
        mantissa, exponent = f"{value:.3e}".split("e")
        text = f"{float(mantissa):g}·10{str(int(exponent)).translate(_RAISED)}"
    return text.replace("-", "−")
