"""The page: one self-contained HTML file, for light and dark screens and for print."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any, Final

from hapticd.figures.markup import STYLE, text
from hapticd.reproduce.items import Comparison, Item, Table, show

# the widest figures fill the page
_REM_PER_INCH: Final = 6.6
# smaller differences are rounding and not shown
_ROUNDING: Final = 1e-12
# relative differences below this are not shown in percent
_SMALL_SHARE: Final = 1e-5


def page(items: Sequence[Item], folder: Path, version: str, quick: bool) -> str:
    """The whole page.

    Args:
        items: in the order of the paper.
        folder: of the figures' SVG files, which are embedded.
        version: of hapticd.
        quick: whether the maps are coarse.
    """
    checks = [comparison for item in items for comparison in item.comparisons]
    differ = [(item, c) for item in items for c in item.comparisons if not c.agrees]
    contents = "".join(f'<li><a href="#{item.name}">{text(item.title)}</a></li>' for item in items)
    coarse = " This is a quick look: coarser maps and shorter runs than the paper's." if quick else ""
    head = (
        "<h1>Stability of Haptic Rendering, reproduced</h1>"
        f'<p class="soft">hapticd {escape(version)}. The tables and figures of Diolaiti, Niemeyer, Barbagli and Salisbury, '
        "“Stability of Haptic Rendering: Discretization, Quantization, Time-Delay and Coulomb Effects”, "
        f"computed anew.{coarse}</p>"
        "<p>Nothing on this page is traced from the paper: every curve and number comes from the code that also runs the "
        "rig. Under each figure stands what the paper prints, or what an independent exact simulation found beforehand, "
        f"beside what ours gives. Of {len(checks)} comparisons {len(checks) - len(differ)} agree; "
        f"{_count(len(differ))}, each with its reason where it stands. Fig. 1, 2 and 10 are block diagrams.</p>"
    )
    body = "".join(_section(item, folder) for item in items)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Stability of Haptic Rendering, reproduced</title><style>{STYLE}</style></head><body>"
        f"{head}<nav><ol>{contents}</ol></nav>{_differences(differ)}{body}</body></html>\n"
    )


def _count(differences: int) -> str:
    return "none differs" if differences == 0 else "1 differs" if differences == 1 else f"{differences} differ"


def _differences(differ: Sequence[tuple[Item, Comparison]]) -> str:
    if not differ:
        return ""
    rows = "".join(
        f'<li><a href="#{item.name}">{text(item.title.split(":")[0])}</a>: {text(c.what)}: '
        f"{text(show(c.printed))} there, {text(show(c.ours))} here. {text(c.note)}</li>"
        for item, c in differ
    )
    return f"<h2>Where they differ</h2><ul>{rows}</ul>"


def _section(item: Item, folder: Path) -> str:
    parts = [f'<section id="{item.name}"><h2>{text(item.title)}</h2>']
    parts += [f"<p>{text(line)}</p>" for line in item.see]
    if item.figure is not None:
        width = item.figure.get_size_inches()[0]
        data = base64.b64encode((folder / f"{item.name}.svg").read_bytes()).decode()
        parts.append(
            f'<figure style="max-width: {_REM_PER_INCH * width:.1f}rem">'
            f'<img alt="{escape(item.alt)}" src="data:image/svg+xml;base64,{data}">'
            f"<figcaption>Also as {item.name}.png and {item.name}.svg beside this page.</figcaption></figure>"
        )
    if item.traps:
        parts.append('<div class="trap">' + "".join(f"<p>{text(line)}</p>" for line in item.traps) + "</div>")
    parts += [_table(table) for table in item.tables]
    if item.comparisons:
        parts.append(_comparisons(item.comparisons))
    return "".join(parts) + "</section>"


def _table(table: Table) -> str:
    numeric = [all(_is_number(row[i]) for row in table.rows) for i in range(len(table.header))]
    head = "".join(f"<th{_class(n)}>{text(line)}</th>" for line, n in zip(table.header, numeric, strict=True))
    rows = "".join(
        "<tr>"
        + "".join(f"<td{_class(n)}>{text(show(cell))}</td>" for cell, n in zip(row, numeric, strict=True))
        + "</tr>"
        for row in table.rows
    )
    caption = f"<caption>{text(table.caption)}</caption>" if table.caption else ""
    return f'<div class="scroll"><table>{caption}<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'


def _is_number(cell: Any) -> bool:
    return not isinstance(cell, str) or cell in ("", "–") or cell.replace(".", "", 1).strip("+-% ").isdigit()


def _class(numeric: bool) -> str:
    return ' class="n"' if numeric else ""


def _comparisons(comparisons: Sequence[Comparison]) -> str:
    rows = "".join(
        f"<tr><td>{text(c.what)}</td><td>{text(c.source)}</td>{_value(c.printed, c.unit)}{_value(c.ours, c.unit)}"
        f'<td class="n">{text(_gap(c))}</td><td>{_verdict(c)}</td><td>{text(c.note)}</td></tr>'
        for c in comparisons
    )
    header = "".join(f"<th>{t}</th>" for t in ("quantity", "source", "printed", "ours", "difference", "", "note"))
    caption = "<caption>Printed beside ours.</caption>"
    return f'<div class="scroll"><table>{caption}<thead><tr>{header}</tr></thead><tbody>{rows}</tbody></table></div>'


def _value(value: float | str, unit: str) -> str:
    number = not isinstance(value, str)
    return f"<td{_class(number)}>{text(f'{show(value)} {unit}'.strip() if number else show(value))}</td>"


def _gap(comparison: Comparison) -> str:
    difference = comparison.difference
    if difference is None:
        return ""
    scale = abs(float(comparison.printed))
    if abs(difference) <= _ROUNDING * max(1.0, scale):
        return "0"
    if scale == 0.0:
        return show(difference)
    if abs(difference) < _SMALL_SHARE * scale:
        return show(difference)
    percent = f"{100.0 * difference / scale:+.2g}".replace("-", "−")
    return f"{show(difference)} ({percent} %)"


def _verdict(comparison: Comparison) -> str:
    return '<span class="good">✓ agrees</span>' if comparison.agrees else '<span class="bad">✗ differs</span>'
