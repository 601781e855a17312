"""The certificate as one HTML file that needs nothing else: verdict, one section a step with figures, limits and picture."""

from __future__ import annotations

import io
from html import escape
from typing import TYPE_CHECKING, Any, Final

from hapticd.config.text import significant
from hapticd.figures.files import write_text
from hapticd.figures.markup import STYLE
from hapticd.figures.style import BLUE, GREEN, GREY, ORANGE, RED, new_figure, style

if TYPE_CHECKING:
    from pathlib import Path

    from hapticd.commission.rig import Rig
    from hapticd.commission.step import Picture

PAGE: Final = "commission.html"
_INKS: Final = (BLUE, ORANGE, GREEN, GREY)
_WORDS: Final = {"pass": "passed", "fail": "FAILED", "skipped": "skipped", "disturbed": "disturbed"}
_MORE: Final = """
.step { display: grid; grid-template-columns: minmax(18rem, 1fr) minmax(20rem, 1.1fr); gap: 0 2rem; align-items: start;
  break-inside: avoid; }
.step h2, .step .wide { grid-column: 1 / -1; }
.step svg { width: 100%; height: auto; background: #fff; border: 1px solid var(--line); border-radius: 6px; }
.skipped { color: var(--soft); font-weight: 400; }
.badge { float: right; font-size: .95rem; }
.step p { margin: .2rem 0 .7rem; }
td:first-child { white-space: nowrap; }
td { overflow-wrap: break-word; max-width: 24rem; }
@media (max-width: 50rem) { .step { display: block; } }
@media print { body { max-width: none; font-size: 10.5pt; padding: 0; } .step h2 { margin-top: 1.2rem; } }
"""


def write_page(rig: Rig, document: dict[str, Any], folder: Path) -> Path:
    """Write the page of a certificate into a folder, and return its path."""
    path = folder / PAGE
    write_text(path, _page(rig, document))
    return path


def _page(rig: Rig, document: dict[str, Any]) -> str:
    passed = document["passed"]
    verdict = "is fit to be used" if passed else "is not fit to be used yet"
    versions = ", ".join(f"{name} {value}" for name, value in document["versions"].items())
    rows = "".join(
        f'<tr><td><a href="#{step["name"]}">{escape(step["title"])}</a></td><td>{_badge(step["result"])}</td>'
        f"<td>{escape(_said(step))}</td></tr>"
        for step in document["steps"]
    )
    sections = "".join(_section(rig, step) for step in document["steps"])
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Commissioning: {escape(document['driver'])} {document['config_digest']}</title>"
        f"<style>{STYLE}{_MORE}</style></head><body>"
        f'<h1>This rig <span class="{"good" if passed else "bad"}">{verdict}</span></h1>'
        f'<p class="soft">Config {document["config_digest"]}, driver {escape(document["driver"])}, {document["made"]}; '
        f"{document['rig_s']:.0f} s at the rig. {escape(versions)}.</p>"
        f'<div class="scroll"><table><tr><th>Step</th><th>Result</th><th>What was found</th></tr>{rows}</table></div>'
        f"{sections}</body></html>\n"
    )


def _said(step: dict[str, Any]) -> str:
    said = str(step["finding"])
    return said[:1].upper() + said[1:]


def _badge(result: str) -> str:
    kind = {"pass": "good", "fail": "bad"}.get(result, "skipped")
    return f'<span class="{kind}">{_WORDS[result]}</span>'


def _section(rig: Rig, step: dict[str, Any]) -> str:
    result = rig.results.get(step["name"])
    picture = _drawn(result.picture) if result is not None and result.picture is not None else ""
    trap = ""
    if step["remedy"]:
        likely = f"<p>Likely: {escape(step['cause'])}.</p>" if step["cause"] else ""
        trap = (
            f'<div class="trap wide"><p><b>{escape(_said(step).rstrip("."))}.</b></p>{likely}'
            f"<p>To do: {escape(step['remedy'])}.</p></div>"
        )
    said = f"<p>{escape(_said(step).rstrip('.'))}.</p>" if not trap and _said(step) else ""
    figures = "".join(
        f"<tr><td>{_name(key)}</td><td>{escape(_value(value))}</td>"
        f"<td>{escape(_value(step['limit'][key])) if key in step['limit'] else ''}</td></tr>"
        for key, value in step["figures"].items()
        if value not in (None, "", [])
    )
    table = f"<table><tr><th>Figure</th><th>Found</th><th>Limit</th></tr>{figures}</table>" if figures else ""
    return (
        f'<section class="step" id="{step["name"]}"><h2>{escape(step["title"])} <span class="badge">'
        f'{_badge(step["result"])}</span></h2><p class="soft wide">{escape(step["will"])}</p>{trap}'
        f"<div>{said}{table}</div><div>{picture}</div></section>"
    )


def _name(key: str) -> str:
    words = key.split("_")
    units = {"A": "A", "us": "µs", "ms": "ms", "s": "s"}
    unit = f", {units[words[-1]]}" if words[-1] in units and len(words) > 1 else ""
    return escape(" ".join(words[:-1] if unit else words) + unit)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return significant(float(value), 4)
    if isinstance(value, list | tuple):
        return "; ".join(_value(each) for each in value)
    return str(value)


def _drawn(picture: Picture) -> str:
    with style():
        figure = new_figure(5.4, 2.6)
        axis = figure.subplots()
        for line, ink in zip(picture.lines, _INKS, strict=False):
            if line.style == "dots":
                axis.plot(line.x, line.y, ".", color=ink, ms=4, label=line.label)
            else:
                drawstyle = "steps-post" if line.style == "steps" else "default"
                axis.plot(line.x, line.y, color=ink, lw=1.3, drawstyle=drawstyle, label=line.label)
        for text, at in picture.marks.items():
            axis.axvline(at, color=RED, lw=0.9, ls="--")
            place = axis.get_xaxis_transform()
            axis.text(at, 0.98, f" {text}", color=RED, fontsize=8, va="top", transform=place)
        axis.set_xlabel(picture.x_label)
        axis.set_ylabel(picture.y_label)
        axis.legend()
        image = io.StringIO()
        figure.savefig(image, format="svg", metadata={"Date": None, "Creator": None})
    text = image.getvalue()
    return text[text.index("<svg") :]
