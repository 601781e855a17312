"""The tutorial, step by step as it is written; its pictures are made here, with HAPTICD_PICTURES=docs/images."""

from __future__ import annotations

import os
from pathlib import Path

from playwright.sync_api import Page, expect

from .browser import Testbed
from .conftest import SIMULATED_MS
from .waiting import drawn

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorials" / "scope.md"
PICTURES = ("scope.png", "scope-drag.png", "scope-fault.png")


def picture(page: Page, name: str) -> None:
    assert name in PICTURES
    page.mouse.move(640, 60)
    drawn(page)
    found = page.screenshot()
    assert len(found) > 20_000
    if folder := os.environ.get("HAPTICD_PICTURES"):
        (Path(folder) / name).write_bytes(found)


def enter(page: Page, key: str, value: object) -> None:
    page.fill(f"#set-{key}-entry", str(value))
    page.press(f"#set-{key}-entry", "Enter")
    expect(page.locator(f"#set-{key}-confirmed")).to_have_text(str(value))


def release(page: Page, deflection: float, duration_s: float) -> None:
    page.click("#to-release")
    page.fill("#release-deflection", str(deflection))
    page.press("#release-deflection", "Tab")
    page.fill("#release-duration", str(duration_s))
    page.click("#release-form button")


def test_the_tutorial(page: Page, testbed: Testbed) -> None:
    # A release, beside the theory.
    enter(page, "encoder-decimation", 217)
    enter(page, "servo-rate_hz", 500)
    expect(page.locator("#region")).to_have_text("D|E")
    release(page, 20.3, 1.5)
    expect(page.locator("#region-here")).to_have_text("E for a release from 20.3 ticks")
    expect(page.locator("#release-residual")).to_contain_text("ticks RMS", timeout=SIMULATED_MS)
    picture(page, "scope.png")

    # A slower loop, held before it is sent.
    page.click("#to-settings")
    slider = page.locator("#set-servo-rate_hz")
    box = slider.bounding_box()
    assert box is not None
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + box["width"] * 0.38, y)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 0.13, y, steps=8)
    words = "would land in D|E, that is D for a release from 20.3 ticks: locally unstable"
    expect(page.locator("#ghost-words")).to_contain_text(words)
    drawn(page)
    found = page.screenshot()
    if folder := os.environ.get("HAPTICD_PICTURES"):
        (Path(folder) / "scope-drag.png").write_bytes(found)
    page.keyboard.press("Home")
    page.mouse.up()

    # There the daemon refuses it; forced, it runs away, into a fault.
    enter(page, "servo-rate_hz", 100)
    release(page, 20.3, 3)
    expect(page.locator("#release-answer")).to_contain_text("region D, at rest 20.3 ticks from the origin")
    page.click("#release-answer button.force")
    page.click("#release-answer button.force-yes")
    expect(page.locator("#region-here")).to_have_text("D for a release from 20.3 ticks")
    expect(page.locator("#state")).to_have_text("fault", ignore_case=True)
    expect(page.locator("#release-outcome")).to_contain_text("growing: it ran away")
    picture(page, "scope-fault.png")
    page.click("#clear")
    expect(page.locator("#banner")).to_be_hidden()
    page.click("#run")


def test_the_tutorial_shows_these_pictures() -> None:
    text = TUTORIAL.read_text(encoding="utf-8")
    for name in PICTURES:
        assert f"../images/{name}" in text
        assert (TUTORIAL.parents[1] / "images" / name).exists()
