"""What the page says of itself: empty axes, one count of missed periods, the trigger, fault pages; and what Esc does."""

from __future__ import annotations

import contextlib
import re

import pytest
from playwright.sync_api import Page, WebSocketRoute, expect

from hapticd.client import RequestRefused
from tests.polling import wait_until

from .browser import Testbed
from .conftest import Open
from .test_page import seen_rows


def hold_back(kind: str, open_page: Open) -> Page:
    """The page, to which one of its WebSockets says nothing."""

    def silent(route: WebSocketRoute) -> None:
        route.connect_to_server().on_message(lambda message: None)

    return open_page(ready=False, before=lambda page: page.route_web_socket(f"**/ws/{kind}", silent))


def test_an_empty_axis_says_that_no_row_has_come(open_page: Open) -> None:
    page = hold_back("rows", open_page)
    expect(page.locator(".lane .empty").first).to_have_text("connected; no row has come yet")


def test_an_empty_axis_says_that_the_config_is_waited_for(open_page: Open) -> None:
    page = hold_back("state", open_page)
    expect(page.locator(".lane .empty").first).to_have_text("waiting for the daemon's configuration")


def test_an_empty_axis_says_that_nobody_is_connected(open_page: Open) -> None:
    page = open_page(ready=False, before=lambda page: page.route_web_socket("**/ws/*", lambda socket: socket.close()))
    expect(page.locator(".lane .empty").first).to_have_text("not connected: no rows come")


def test_a_lane_without_values_says_why(page: Page) -> None:
    wait_until(lambda: seen_rows(page) > 1000, "rows")
    expect(page.locator(".lane .empty").first).to_be_hidden()
    page.check("#lane-residual")
    expect(page.locator(".lane .empty:visible")).to_have_text("no release yet: the residual is measured less simulated")


def test_there_is_one_count_of_missed_periods(page: Page, testbed: Testbed) -> None:
    """The daemon's, wherever it stands; what the page has not got is lost, and called so."""
    wait_until(lambda: seen_rows(page) > 1000, "rows")
    page.click("#to-health")
    read = "ids => [document.body.innerText, ...ids.map((id) => document.getElementById(id).textContent)]"
    # at one instant: what is counted goes on meanwhile
    body, place, gaps, missed, health = page.evaluate(read, ["gap-place", "gaps", "missed", "h-missed"])
    assert not re.search(r"\d+ missed", place)
    assert gaps == "0 rows lost on the way"
    assert missed.split()[0] == health.split()[0] == re.findall(r"(\d+) (?:periods )?missed", body)[0]


def test_the_trigger_says_what_it_does_in_the_units_of_its_channel(page: Page, testbed: Testbed) -> None:
    state = page.locator("#trigger-state")
    expect(state).to_have_text("")
    page.select_option("#trigger-mode", "normal")
    expect(page.locator(".trigger-unit").first).to_have_text("ticks")
    page.fill("#trigger-level", "1000")
    page.press("#trigger-level", "Enter")
    expect(state).to_have_text("armed: fires at 1000 ticks, rising")
    page.select_option("#trigger-on", "falling")
    expect(state).to_have_text("waiting: it must first be above 1001 ticks")
    page.select_option("#trigger-on", "release")
    expect(state).to_have_text("armed: fires at the start of rendering")
    testbed.client.start()
    expect(state).to_contain_text("fired at ")
    expect(state).to_have_attribute("data-state", "fired")


@pytest.mark.parametrize(
    ("channel", "unit"), [("velocity", "rad/s"), ("current", "A"), ("force", "N m"), ("late", "µs")]
)
def test_the_hysteresis_is_one_of_its_channel(page: Page, channel: str, unit: str) -> None:
    page.select_option("#trigger-mode", "normal")
    page.select_option("#trigger-channel", channel)
    for place in page.locator(".trigger-unit").all():
        expect(place).to_have_text(unit)
    expect(page.locator("#trigger-hysteresis")).not_to_have_value("0.5")
    assert 0.0 < float(page.locator("#trigger-hysteresis").input_value()) < 10.0
    page.select_option("#trigger-channel", "position")
    expect(page.locator("#trigger-hysteresis")).to_have_value("0.5")


def test_a_level_may_have_a_unit_of_its_own(page: Page) -> None:
    page.select_option("#trigger-mode", "normal")
    page.fill("#trigger-level", "0.2rad")
    page.press("#trigger-level", "Enter")
    expect(page.locator("#trigger-state")).to_contain_text("260.8 ticks, rising")  # 0.2 · 8192 / 2π


def test_a_fault_page_is_set_and_not_its_markup(page: Page, testbed: Testbed) -> None:
    testbed.client.estop()
    expect(page.locator("#banner-title")).to_have_text("Fault: estop")
    page.click("#fault-page")
    body = page.locator("#page-text")
    expect(body.locator("h3", has_text="What hapticd did")).to_be_visible()
    assert body.locator("ol li").count() >= 1
    assert body.locator("code").count() >= 1
    shown = body.inner_text() + page.locator("#banner").inner_text()
    assert not re.search(r"`|\*\*|^#|^\||\]\(", shown, re.MULTILINE)


def test_every_fault_page_is_set_without_markup(page: Page) -> None:
    from hapticd.fault_pages import fault_page
    from hapticd.servo.faults import NUMBERS

    for code in NUMBERS:
        shown = page.evaluate(
            """async (text) => {
                const { markdown } = await import("/static/js/markdown.js");
                const place = document.createElement("div");
                place.append(...markdown(text, () => {}));
                for (const code of place.querySelectorAll("code, pre")) code.remove();
                return place.innerText;
            }""",
            fault_page(code),
        )
        assert not re.search(r"`|\*\*|^#|^\||\]\(", shown, re.MULTILINE), code


def test_a_page_leads_to_the_next(page: Page, testbed: Testbed) -> None:
    testbed.client.set({"safety.max_velocity": 20, "encoder.decimation": 217, "safety.guard": "off"})
    with contextlib.suppress(RequestRefused):  # the fault may come before the answer
        testbed.client.release(20.3, 1)
    expect(page.locator("#banner-title")).to_have_text("Fault: over_speed")
    page.click("#fault-page")
    page.click("#page-text button.link >> text=encoder_jump")
    expect(page.locator("#page-title")).to_have_text("encoder_jump")


@pytest.mark.parametrize("opened", ["#help", "#fault-page"])
def test_esc_stops_with_a_panel_open_and_the_stops_stay_within_reach(page: Page, testbed: Testbed, opened: str) -> None:
    """One key, one meaning: Esc stops, always, and closes nothing."""
    if opened == "#fault-page":
        testbed.client.estop()
        page.click(opened)
        testbed.client.clear()
    else:
        page.click(opened)
    panel = page.locator("dialog[open]")
    expect(panel).to_be_visible()
    testbed.client.start()
    page.keyboard.press("Escape")
    wait_until(lambda: testbed.state() == "off", "a stop by Esc")
    expect(panel).to_be_visible()
    testbed.client.start()
    page.click("#stop")  # not behind the panel, and not inert
    wait_until(lambda: testbed.state() == "off", "a stop by its button")
    panel.locator("button.close").click()
    expect(panel).to_be_hidden()


def test_help_opens_and_closes_with_its_key(page: Page) -> None:
    page.locator("body").press("?")
    expect(page.locator("#keys")).to_be_visible()
    page.keyboard.press("?")
    expect(page.locator("#keys")).to_be_hidden()
