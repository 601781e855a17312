"""Until the page has drawn what it knows: it draws sixty times a second, tells values ten times, and has none before."""

from __future__ import annotations

from playwright.sync_api import Page

TOLD = 12
"""Frames within which values are told at least once."""


def drawn(page: Page, frames: int = TOLD) -> None:
    """Wait until the page has drawn so many more frames, and told its values since."""
    before = int(page.locator("body").get_attribute("data-frames") or 0)
    page.wait_for_function("(frame) => Number(document.body.dataset.frames) >= frame", arg=before + frames)
