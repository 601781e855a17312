"""What comes late, in another order, or faster than the page draws: a busy machine and a slow network make all of it."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest
from playwright.sync_api import Page, Route, WebSocketRoute, expect

from hapticd.record import read_run
from tests.polling import wait_until

from .browser import Testbed
from .conftest import SIMULATED_MS, Open
from .test_page import seen_rows, text
from .test_pictures import SVG

PRESS = """(keys) => {
    for (const key of keys) document.body.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
}"""
"""All in one task: no frame is drawn between them."""


class Late:
    """Rows on their way to a page, which are held up for a while."""

    def __init__(self, page: Page) -> None:
        self.holds = False
        self.held: list[str | bytes] = []
        page.route_web_socket("**/ws/rows", self._connect)

    def _connect(self, route: WebSocketRoute) -> None:
        self.route = route
        route.connect_to_server().on_message(self._take)

    def _take(self, message: str | bytes) -> None:
        if self.holds:
            self.held.append(message)
        else:
            self.route.send(message)

    def let_go(self) -> None:
        for message in self.held:
            self.route.send(message)
        self.held.clear()
        self.holds = False


def test_a_release_is_whole_when_the_state_comes_before_the_rows(open_page: Open, testbed: Testbed) -> None:
    late: list[Late] = []
    page = open_page(before=lambda page: late.append(Late(page)))
    if page.locator("body").get_attribute("data-control") != "mine":
        page.click("#take")
    expect(page.locator("#lease")).to_have_text("this page has the controls")
    wait_until(lambda: seen_rows(page) > 500, "rows")
    late[0].holds = True
    page.click("#to-release")
    page.fill("#release-deflection", "3")
    page.fill("#release-duration", "0.3")
    page.click("#release-form button")
    wait_until(lambda: testbed.client.experiment()["state"] == "done", "the end of the release")
    expect(page.locator("#release-answer")).to_contain_text("released from 3 ticks")
    page.wait_for_timeout(1500)  # the page is told of the end twice and more
    assert text(page, "#hold-why") == ""
    late[0].let_go()
    expect(page.locator("#release-outcome")).not_to_have_text("")
    expect(page.locator("#hold-why")).to_contain_text("the release, taken as a single shot")
    expect(page.locator("#release-residual")).to_contain_text("ticks RMS", timeout=SIMULATED_MS)
    rows = int(text(page, "#release-residual").partition(" over ")[2].split()[0])
    assert rows >= 290
    name = Path(testbed.client.experiment()["result"]["run"]).name
    page.click("#to-files")
    with page.expect_download() as found:
        page.click("#save-svg")
    assert name in Path(found.value.path()).read_text()


@pytest.mark.parametrize(("typed", "then"), [("0.02", "0.02"), ("2,5", "0.012")])
def test_a_field_that_is_left_while_it_is_sent_shows_what_became_of_it(page: Page, typed: str, then: str) -> None:
    waiting: list[Route] = []
    page.route("**/api/set", lambda route: waiting.append(route))
    entry = page.locator("#set-spring-stiffness-entry")
    entry.fill(typed)
    entry.press("Enter")
    page.click("#trace .bar", position={"x": 2, "y": 2})
    wait_until(lambda: bool(waiting), "the request")
    expect(entry).to_have_value(typed)
    waiting[0].continue_()
    expect(page.locator("#set-spring-stiffness-confirmed")).to_have_text(then)
    expect(entry).to_have_value(then)
    expect(entry).not_to_have_class("unsent")


def test_keys_faster_than_frames_zoom_about_the_middle_and_what_is_saved_is_what_is_meant(
    page: Page, tmp_path: Path
) -> None:
    wait_until(lambda: seen_rows(page) > 1900, "two seconds of rows")
    page.locator("body").press(" ")
    page.click("#to-files")
    runs = []
    for keys in ([], ["+", "+", "+"]):
        with page.expect_download() as found:
            page.evaluate(f"(keys) => {{ ({PRESS})(keys); document.querySelector('#save-arrow').click(); }}", keys)
        found.value.save_as(tmp_path / "seen.arrow")
        runs.append(read_run(tmp_path / "seen.arrow"))
    wide, narrow = (run.columns["tick"] for run in runs)
    assert narrow[-1] - narrow[0] == pytest.approx(0.8**3 * 2000, abs=4)  # of two seconds at 1 kHz
    assert (narrow[0] + narrow[-1]) / 2 == pytest.approx(wide[-1] - 1000, abs=4)


def test_a_picture_has_the_lane_that_was_chosen_a_moment_ago(page: Page) -> None:
    wait_until(lambda: seen_rows(page) > 1900, "rows")
    page.locator("body").press(" ")
    page.click("#to-files")
    with page.expect_download() as found:
        page.evaluate("for (const id of ['lane-force', 'save-svg']) document.getElementById(id).click()")
    root = ElementTree.parse(found.value.path()).getroot()
    assert any((each.text or "").startswith("Force (") for each in root.iter(f"{SVG}text"))
    force = [path.get("d", "") for path in root.iter(f"{SVG}path") if path.get("stroke-width") == "1.25"][-1]
    assert force.count("L") > 100
