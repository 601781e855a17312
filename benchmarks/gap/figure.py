"""The confusion matrix as text and as a picture."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from benchmarks.gap.hidden import LAWS

VERDICTS = ("no_missing_effect", "partly_explained", "ambiguous", "unexplained", "late", "failed")


def axes_of(confusion: dict[str, Counter[str]]) -> tuple[list[str], list[str]]:
    """Rows and columns of the matrix: the catalogue's order, then the verdicts that are not sure of a name."""
    rows = [slug for slug in (*LAWS, "none") if slug in confusion]
    named = {name for counts in confusion.values() for name in counts}
    return rows, [name for name in (*LAWS, *VERDICTS) if name in named or name in rows]


def text(confusion: dict[str, Counter[str]]) -> str:
    """Hidden effects down, first names across; columns are numbered and listed below."""
    rows, columns = axes_of(confusion)
    lines = [f"{'hidden':24}" + "".join(f"{number:>4}" for number in range(1, len(columns) + 1))]
    for row in rows:
        cells = "".join(f"{confusion[row][name] or '·':>4}" for name in columns)
        lines.append(f"{row:24}{cells}")
    lines += [f"{number:4} {name}" for number, name in enumerate(columns, 1)]
    return "\n".join(lines)


def draw(confusion: dict[str, Counter[str]], path: Path, title: str) -> None:
    """The matrix as a picture: shares of each row, counts in the cells."""
    from matplotlib.figure import Figure

    rows, columns = axes_of(confusion)
    counts = np.array([[confusion[row][name] for name in columns] for row in rows], float)
    shares = counts / counts.sum(axis=1, keepdims=True)
    figure = Figure(figsize=(2.5 + 0.36 * len(columns), 2.5 + 0.3 * len(rows)), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    axes.set_xticks(range(len(columns)), columns, rotation=90)
    axes.set_yticks(range(len(rows)), rows)
    axes.set(xlabel="first name, or verdict", ylabel="hidden", title=title)
    for (i, j), count in np.ndenumerate(counts):
        if count:
            colour = "white" if shares[i, j] > 0.6 else "black"
            axes.text(j, i, f"{count:.0f}", ha="center", va="center", fontsize=7, color=colour)
    figure.colorbar(image, label="share of the row", shrink=0.6)
    part = path.with_name(f".{path.name}.part.png")
    figure.savefig(part, dpi=130)
    part.replace(path)
