"""A person at the page, who does all that it has, round after round; no row is lost on the way meanwhile."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from hapticd.record import read_run

from .browser import Testbed
from .conftest import SETTINGS, Open
from .test_page import text
from .test_round_trip import release
from .test_sequence import TEXT, play
from .test_views import lost_ticks, open_file, save
from .waiting import captured, drawn

TEN_MINUTES_S = 600.0


def one_round(page: Page, testbed: Testbed, folder: Path) -> None:
    """Release, save, scroll back, open, X-Y, reopen, trigger, remedies, note, sequence, stop."""
    release(page, "30deg", "0.3")
    csv = save(page, "csv", folder / "release.csv")
    page.click("#run")
    page.locator("body").press(" ")
    for _ in range(4):
        page.keyboard.press("ArrowLeft")
    drawn(page)
    page.locator("#lane-xy").set_checked(True)
    open_file(page, csv)
    expect(page.locator("#xy-words")).to_contain_text("in N m over ticks")
    again = save(page, "arrow", folder / "again.arrow")
    open_file(page, again)
    page.click("#back")
    page.locator("#lane-xy").set_checked(False)
    page.select_option("#trigger-mode", "single")
    page.select_option("#trigger-on", "release")
    page.click("#to-settings")
    page.click("#start")
    expect(page.locator("#hold-why")).to_have_text("single shot taken")
    page.select_option("#trigger-mode", "roll")
    page.fill("#set-spring-stiffness-entry", "400")
    page.press("#set-spring-stiffness-entry", "Enter")
    refusal = page.locator("#set-spring-stiffness-refusal")
    refusal.locator("button.apply[data-key='spring.stiffness']").click()
    expect(page.locator("#set-spring-stiffness-confirmed")).not_to_have_text("0.012")
    page.keyboard.press("Escape")
    expect(page.locator("#state")).to_have_text("off", ignore_case=True)
    testbed.client.set({"spring.stiffness": SETTINGS["spring.stiffness"]})
    expect(page.locator("#record")).to_have_text("Record")  # the run of the start is closed
    page.click("#record")
    expect(page.locator("#record")).to_have_text("Stop recording")
    page.click("#to-notes")
    before = page.locator("#notes li").count()
    page.fill("#note-text", "it buzzed")
    page.press("#note-text", "Enter")
    expect(page.locator("#notes li")).to_have_count(before + 1)
    page.click("#to-settings")
    page.click("#record")
    expect(page.locator("#record")).to_have_text("Record")
    play(page, TEXT)
    expect(page.locator("#sequence-answer")).to_have_text("done: 2 of 2 releases")
    if text(page, "#run") == "Run":
        page.click("#run")


def session(page: Page, testbed: Testbed, folder: Path, duration_s: float) -> int:
    """Rounds for so long; rows that were taken meanwhile."""
    end, before = time.monotonic() + duration_s, captured(page)
    while True:
        one_round(page, testbed, folder)
        expect(page.locator("#gaps")).to_have_text("0 rows lost on the way")
        if time.monotonic() >= end:
            break
    page.select_option("#window", "10")
    drawn(page)
    page.click("#run")
    run = read_run(save(page, "arrow", folder / "last.arrow"))
    assert lost_ticks(run) == 0
    return captured(page) - before


def test_a_person_loses_no_row(page: Page, testbed: Testbed, tmp_path: Path) -> None:
    assert session(page, testbed, tmp_path, 0.0) > 1000


@pytest.mark.attack
@pytest.mark.timeout(1800)
def test_ten_minutes_at_10_khz_lose_no_row(open_page: Open, tmp_path: Path) -> None:
    testbed = Testbed(tmp_path, servo={"rate_hz": 10_000})
    try:
        testbed.start_daemon()
        testbed.start_scope()
        page = open_page(testbed.url)  # the first page has the controls
        expect(page.locator("#lease")).to_have_text("this page has the controls")
        before = testbed.client.status()["timing"]
        rows = session(page, testbed, tmp_path, TEN_MINUTES_S)
        after = testbed.client.status()["timing"]
        ticks, missed = (after[name] - before[name] for name in ("ticks", "missed"))
        print(f"{rows} rows of {ticks} ticks; the machine missed {missed} periods")
        assert rows > 0.99 * ticks  # those of the first and last moments are on their way
    finally:
        testbed.close()
