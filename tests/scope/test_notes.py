"""Notes and markers from the page, and those of others in it."""

from __future__ import annotations

from pathlib import Path

from playwright.sync_api import Page, expect

from hapticd.record import read_run
from tests.polling import wait_until

from .browser import Testbed
from .conftest import Open
from .test_views import open_file, save
from .waiting import drawn


def noted(path: Path) -> list[object]:
    events = read_run(path).events
    return [e.get("text") or (e["name"], e["value"]) for e in events if e["event"] in ("note", "marker")]


def test_notes_of_all_are_in_the_run_and_in_the_page(
    page: Page, open_page: Open, testbed: Testbed, tmp_path: Path
) -> None:
    page.click("#to-notes")
    page.fill("#note-text", "before anything")
    page.press("#note-text", "Enter")
    expect(page.locator("#note-answer")).to_contain_text("nothing is being recorded")
    page.fill("#record-subject", "07")
    page.press("#record-subject", "Enter")
    wait_until(lambda: testbed.client.config()["record"]["subject"] == "07", "the subject in force")
    testbed.client.start()
    page.fill("#note-text", "the operator let go")
    page.press("#note-text", "Enter")
    expect(page.locator("#note-answer")).to_contain_text("at tick")
    expect(page.locator("#note-text")).to_have_value("")
    page.fill("#marker-value", "0")
    page.click("#marker-form button")
    page.click("#trace .bar")
    page.fill("#marker-value", "")
    page.locator("#marker-value").blur()
    expect(page.locator("#notes li")).to_have_count(2)
    page.keyboard.press("m")
    expect(page.locator("#notes li")).to_have_count(3)
    testbed.client.marker("stimulus_onset", 3.5)  # what an experiment's own software sends
    expect(page.locator("#notes li")).to_have_count(4)
    other = open_page()  # holds no controls, and may note all the same
    other.click("#to-notes")
    other.fill("#note-text", "from elsewhere")
    other.press("#note-text", "Enter")
    expect(page.locator("#notes li")).to_have_count(5)
    expect(page.locator("#notes li").first).to_contain_text("from elsewhere")
    expect(page.locator("body")).to_have_attribute("data-marks", "5")
    path = Path(testbed.client.status()["recorder"]["path"])
    page.select_option("#window", "50")
    drawn(page)
    page.click("#run")
    saved = save(page, "arrow", tmp_path / "seen.arrow")
    testbed.client.stop()
    everything = ["the operator let go", ("mark", 0), ("mark", None), ("stimulus_onset", 3.5), "from elsewhere"]
    assert noted(path) == everything
    assert read_run(path).metadata["config"]["record"]["subject"] == "07"
    assert noted(saved) == everything
    expect(page.locator("#record")).to_have_text("Record")  # the page knows that it is over
    drawn(page)
    expect(page.locator("body")).to_have_attribute("data-marks", "5")
    open_file(page, path)
    expect(page.locator("body")).to_have_attribute("data-marks", "5")
    testbed.client.set({"record.subject": None})
