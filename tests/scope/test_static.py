"""What the page is made of: nothing from elsewhere, nothing inline, and uPlot as it was published."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hapticd.scope import app

STATIC = app.STATIC
UPLOT = STATIC / "vendor" / "uplot"
VERSION = "1.6.32"
OWN = [
    path
    for path in sorted(STATIC.rglob("*"))
    if path.suffix in (".html", ".css", ".js", ".svg") and UPLOT not in path.parents
]


def test_uplot_is_the_version_that_is_written_down() -> None:
    assert f"(v{VERSION})" in (UPLOT / "uPlot.iife.min.js").read_text(encoding="utf-8")[:100]
    assert f"uPlot {VERSION}" in (UPLOT / "README.md").read_text(encoding="utf-8")
    assert "The MIT License" in (UPLOT / "LICENSE").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", OWN, ids=lambda path: path.name)
def test_nothing_is_fetched_from_elsewhere_and_no_text_becomes_markup(path: Path) -> None:
    text = path.read_text(encoding="utf-8").replace("http://www.w3.org/2000/svg", "")
    assert not re.search(r"https?://", text)
    for word in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "new Function"):
        assert word not in text


def test_the_page_has_nothing_inline() -> None:
    """The content policy would refuse it."""
    text = (STATIC / "index.html").read_text(encoding="utf-8")
    assert not re.search(r"<script(?![^>]*\bsrc=)", text)
    assert "<style" not in text
    assert not re.search(r"\s(on\w+|style)=", text)


def test_the_stop_comes_first() -> None:
    """Its script is the first of the page, stands right behind its buttons, waits for nothing and imports nothing."""
    text = (STATIC / "index.html").read_text(encoding="utf-8")
    assert re.search(r"<script[^>]*>", text).group() == '<script src="/static/stop.js">'  # type: ignore[union-attr]
    assert text.index('id="estop"') < text.index("stop.js")
    assert not re.search(r"^\s*import", (STATIC / "stop.js").read_text(encoding="utf-8"), re.MULTILINE)


def test_every_fault_has_a_page_to_show() -> None:
    from hapticd.fault_pages import fault_page
    from hapticd.servo.faults import NUMBERS

    for code in NUMBERS:
        assert "\n## How to clear\n" in (fault_page(code) or "")
