"""On a phone of 390 by 844: the stops and the state always, one lane, and no word over a number."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from tests.polling import wait_until

from .browser import Testbed
from .conftest import Open
from .test_page import seen_rows
from .waiting import drawn

WIDTH, HEIGHT = 390, 844

OVERLAPS = """() => {
    const seen = (node) => node.checkVisibility({ visibilityProperty: true }) && node.getClientRects().length;
    const texts = [];
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    for (let node = walker.nextNode(); node; node = walker.nextNode()) {
        const parent = node.parentElement;
        if (!node.data.trim() || !seen(parent) || parent.closest("svg, canvas, dialog, option, script, .uplot")) continue;
        const range = document.createRange();
        range.selectNodeContents(node);
        for (const box of range.getClientRects()) {
            if (box.width > 1 && box.height > 1) texts.push([node.data.trim().slice(0, 40), box, parent]);
        }
    }
    const found = [];
    for (let i = 0; i < texts.length; i++) {
        const [text, a, parent] = texts[i];
        if (a.left < -1 || a.right > innerWidth + 1) found.push(`${text} runs off: ${a.left}..${a.right}`);
        const header = (node) => Boolean(node.closest("header"));
        for (let j = i + 1; j < texts.length; j++) {
            const [other, b, its] = texts[j];
            if (header(parent) !== header(its)) continue; // what is scrolled under the header is not seen
            const width = Math.min(a.right, b.right) - Math.max(a.left, b.left);
            const height = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
            if (width > 2 && height > 4) found.push(`${text} over ${other}`);
        }
    }
    return found;
}"""


@pytest.fixture
def phone(open_page: Open, testbed: Testbed) -> Page:
    page = open_page(before=lambda page: page.set_viewport_size({"width": WIDTH, "height": HEIGHT}))
    if page.locator("body").get_attribute("data-control") != "mine":
        page.click("#take")
    expect(page.locator("#lease")).to_have_text("this page has the controls")
    wait_until(lambda: seen_rows(page) > 500, "rows")
    return page


def nothing(page: Page, testbed: Testbed) -> None:
    pass


def release(page: Page, testbed: Testbed) -> None:
    testbed.client.set({"encoder.decimation": 217, "servo.rate_hz": 500})
    page.click("#to-release")
    page.fill("#release-deflection", "10.3")
    page.fill("#release-duration", "0.5")
    page.click("#release-form button")
    expect(page.locator("#release-outcome")).not_to_have_text("")


def refusal(page: Page, testbed: Testbed) -> None:
    page.fill("#set-spring-stiffness-entry", "40")
    page.press("#set-spring-stiffness-entry", "Enter")
    expect(page.locator("button.force")).to_be_visible()


def fault(page: Page, testbed: Testbed) -> None:
    testbed.client.estop()
    expect(page.locator("#banner")).to_be_visible()


def tab(name: str) -> Callable[[Page, Testbed], None]:
    def click(page: Page, testbed: Testbed) -> None:
        page.click(f"#to-{name}")
        drawn(page)

    return click


def residual(page: Page, testbed: Testbed) -> None:
    page.check("#lane-residual")
    page.click("#more")


@pytest.mark.parametrize(
    "shown",
    [nothing, release, refusal, fault, residual, tab("measure"), tab("health"), tab("files")],
    ids=["start", "release", "refusal", "fault", "residual", "measure", "health", "files"],
)
def test_no_word_lies_over_another_or_runs_off(
    phone: Page, testbed: Testbed, shown: Callable[[Page, Testbed], None]
) -> None:
    shown(phone, testbed)
    assert phone.evaluate("document.documentElement.scrollWidth") <= WIDTH
    assert phone.evaluate(OVERLAPS) == []


def test_the_stops_and_the_state_stay_while_all_else_scrolls(phone: Page, testbed: Testbed) -> None:
    testbed.client.start()
    expect(phone.locator("#state")).to_have_text("running", ignore_case=True)
    phone.locator("aside").last.scroll_into_view_if_needed()
    phone.evaluate("document.querySelector('main').scrollTo(0, 1e6)")
    for selector in ("#stop", "#estop", "#state"):
        box = phone.locator(selector).bounding_box()
        assert box is not None
        assert box["y"] >= 0
        assert box["y"] + box["height"] <= HEIGHT
        assert box["x"] + box["width"] <= WIDTH
    stop = phone.locator("#stop").bounding_box()
    assert stop is not None
    assert stop["height"] >= 44
    phone.click("#stop")
    wait_until(lambda: testbed.state() == "off", "a stop")


def test_there_is_one_lane_and_it_is_large_enough(phone: Page) -> None:
    assert phone.locator(".lane").count() == 1
    box = phone.locator(".lane .u-over").bounding_box()
    assert box is not None
    assert box["height"] >= 140
    assert box["width"] >= 280
    phone.check("#lane-current")
    expect(phone.locator(".lane")).to_have_count(1)
    expect(phone.locator(".lane .lane-head strong")).to_have_text("Current")
    expect(phone.locator("#lane-position")).not_to_be_checked()


def test_a_fault_page_begins_at_its_beginning(phone: Page, testbed: Testbed) -> None:
    testbed.client.estop()
    phone.click("#fault-page")
    page = phone.locator("#page")
    expect(page).to_be_visible()
    assert page.evaluate("page => [page.scrollHeight > page.clientHeight, page.scrollTop]") == [True, 0]


def test_the_header_leaves_room(phone: Page) -> None:
    box = phone.locator("header").bounding_box()
    assert box is not None
    assert box["height"] <= 150
