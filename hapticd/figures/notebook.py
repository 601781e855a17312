"""What a notebook shows of a result: a few lines and a trace, as HTML and SVG without any library."""

from __future__ import annotations

import html
import itertools
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

_WIDTH, _HEIGHT, _MARGIN = 640, 140, 4


def card(title: str, lines: Iterable[tuple[str, str]], picture: str = "") -> str:
    """A heading, names with their texts, and a picture below."""
    rows = "".join(
        f"<tr><th style='text-align:left'>{html.escape(name)}</th><td>{html.escape(text)}</td></tr>"
        for name, text in lines
    )
    return f"<div><b>{html.escape(title)}</b><table>{rows}</table>{picture}</div>"


def trace(x: NDArray[np.float64], y: NDArray[np.float64], unit: str) -> str:
    """A line of y over x, (n,) each, with the smallest and largest of each column of pixels; its ends are named."""
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    if x.size < 2:
        return ""
    left, right, low, high = float(x[0]), float(x[-1]), float(y.min()), float(y.max())
    edges = np.unique(np.linspace(0, x.size, min(x.size, _WIDTH) + 1).astype(int))
    points = []
    for begin, end in itertools.pairwise(edges):
        part = y[begin:end]
        ends = (part.min(), part.max()) if part[0] <= part[-1] else (part.max(), part.min())
        across = _MARGIN + (_WIDTH - 2 * _MARGIN) * (float(x[begin]) - left) / ((right - left) or 1.0)
        points += [
            f"{across:.1f},{_HEIGHT - _MARGIN - (_HEIGHT - 2 * _MARGIN) * (float(end) - low) / ((high - low) or 1.0):.1f}"
            for end in (ends if part.size > 1 else ends[:1])
        ]
    return (
        f"<svg viewBox='0 0 {_WIDTH} {_HEIGHT}' width='{_WIDTH}' height='{_HEIGHT}' role='img' "
        f"aria-label='{low:.4g} to {high:.4g} {html.escape(unit)}'>"
        f"<polyline points='{' '.join(points)}' fill='none' stroke='currentColor' stroke-width='1'/></svg>"
        f"<div>{low:.4g} to {high:.4g} {html.escape(unit)} over {right - left:.4g} s</div>"
    )
