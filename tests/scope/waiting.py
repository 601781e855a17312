"""Until the page has drawn what it knows: it draws sixty times a second, tells values ten times, and has none before."""

from __future__ import annotations

from playwright.sync_api import Page

TOLD = 12
"""Frames within which values are told at least once."""


def drawn(page: Page, frames: int = TOLD) -> None:
    """Wait until the page has drawn so many more frames, and told its values since."""
    before = int(page.locator("body").get_attribute("data-frames") or 0)
    page.wait_for_function("(frame) => Number(document.body.dataset.frames) >= frame", arg=before + frames)


def captured(page: Page) -> int:
    """Rows that the page has taken since it was opened, seen or not."""
    return int(page.locator("body").get_attribute("data-captured") or 0)


def captures(page: Page, rows: int) -> None:
    """Wait until it has taken so many more."""
    page.wait_for_function("(row) => Number(document.body.dataset.captured) >= row", arg=captured(page) + rows)
