"""What a table or figure of the paper becomes: pictures, tables, words, and printed numbers beside ours."""

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
    """A number or a statement of a source beside what our code finds.

    Attributes:
        what: the quantity or claim.
        source: where `printed` comes from.
        printed: the source's number, or its claim in words.
        ours: our number, or what we find.
        agrees: whether they agree, a number within its tolerance.
        unit: of both numbers.
        note: why they differ, or what to know.
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
        """Ours less printed; None for words."""
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
    """Compare two numbers; they agree when they differ by no more than an absolute tolerance."""
    return Comparison(what, source, printed, ours, abs(ours - printed) <= tolerance, unit, note)


@dataclass(frozen=True)
class Table:
    """A table of the page.

    Attributes:
        header: names of the columns.
        rows: text is shown as it is, numbers to five digits.
        caption: a sentence above it.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""


@dataclass(frozen=True)
class Item:
    """One table or figure of the paper, reproduced. Texts are plain text.

    Attributes:
        name: ``table1`` … ``fig12``, also the stem of its files.
        title: heading.
        see: what the reader should see.
        traps: where the paper's text or numbers mislead, and what is done about it.
        figure: the picture; None for a table.
        alt: what the picture shows, for those who cannot see it.
        tables: the numbers behind it.
        comparisons: printed beside ours.
        numbers: everything else worth keeping, JSON-ready.
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
