"""Every field of the page from which a number goes to the daemon: what is typed is read as the command line reads it.

Else it is refused at the field; nothing is ever put in its place.
"""

from __future__ import annotations

import pytest
from playwright.sync_api import Page, expect

from hapticd.config import load_config
from hapticd.config.units import deflection_ticks

from .browser import Testbed
from .served import Served

UNREADABLE = ["2,5", "5mm", "", "   ", "fast", "1e999", "10 3"]
QUANTITY = {"text": "2", "unit": "s"}


def release(page: Page, deflection: str, duration: str) -> None:
    page.click("#to-release")
    page.fill("#release-deflection", deflection)
    page.fill("#release-duration", duration)
    page.click("#release-form button")


def enter(page: Page, selector: str, text: str) -> None:
    page.fill(selector, text)
    page.press(selector, "Enter")


@pytest.mark.parametrize("typed", UNREADABLE)
def test_a_deflection_that_cannot_be_read_releases_nothing(page: Page, testbed: Testbed, typed: str) -> None:
    before = testbed.client.experiment()["id"]
    release(page, typed, "0.2")
    expect(page.locator("#release-deflection-refusal")).not_to_have_text("")
    expect(page.locator("#release-deflection")).to_have_value(typed)
    assert (testbed.state(), testbed.client.experiment()["id"]) == ("off", before)


@pytest.mark.parametrize("typed", [*sorted({*UNREADABLE} - {"5mm"}), "0", "-1", "2rad"])
def test_a_duration_that_cannot_be_read_releases_nothing(page: Page, testbed: Testbed, typed: str) -> None:
    before = testbed.client.experiment()["id"]
    release(page, "2", typed)
    expect(page.locator("#release-duration-refusal")).not_to_have_text("")
    assert (testbed.state(), testbed.client.experiment()["id"]) == ("off", before)


def test_a_comma_is_told_what_it_should_be(page: Page) -> None:
    release(page, "2,5", "0.2")
    expect(page.locator("#release-deflection-refusal")).to_contain_text("the decimal sign is a point: 2.5")


@pytest.mark.parametrize(("typed", "ticks"), [("2.5", 2.5), ("0", 0.0), ("-3 ticks", -3.0), ("30mrad", None)])
def test_a_release_is_from_what_was_typed(page: Page, testbed: Testbed, typed: str, ticks: float | None) -> None:
    config = load_config(None)
    asked = deflection_ticks(typed, config) if ticks is None else ticks
    release(page, typed, "200ms")
    expect(page.locator("#release-outcome")).not_to_have_text("")
    achieved = float(page.locator("#release-answer").inner_text().split()[2])
    assert achieved == pytest.approx(asked, abs=0.5)
    assert testbed.state() == "off"


@pytest.mark.parametrize(
    ("key", "typed", "shown", "value"),
    [
        ("spring-stiffness", "15 mN m/rad", "0.015", 0.015),
        ("servo-rate_hz", "0.5kHz", "500", 500),
        ("delay-computation_s", "0.2", "0.2", 2e-4),
        ("delay-computation_s", "300us", "0.3", 3e-4),
    ],
)
def test_a_setting_is_what_was_typed(
    page: Page, testbed: Testbed, key: str, typed: str, shown: str, value: float
) -> None:
    enter(page, f"#set-{key}-entry", typed)
    expect(page.locator(f"#set-{key}-confirmed")).to_have_text(shown)
    section, _, name = key.partition("-")
    assert testbed.client.config()[section][name] == pytest.approx(value)


@pytest.mark.parametrize("key", ["spring-stiffness", "encoder-decimation", "servo-rate_hz", "delay-computation_s"])
@pytest.mark.parametrize("typed", ["2,5", "5mm", "", "2.5.1"])
def test_a_setting_that_cannot_be_read_is_refused_at_its_field(
    page: Page, testbed: Testbed, key: str, typed: str
) -> None:
    before = testbed.client.config()
    enter(page, f"#set-{key}-entry", typed)
    expect(page.locator(f"#set-{key}-refusal")).not_to_have_text("")
    assert testbed.client.config() == before


def test_a_part_of_a_count_is_not_rounded(page: Page, testbed: Testbed) -> None:
    enter(page, "#set-encoder-decimation-entry", "2.5")
    expect(page.locator("#set-encoder-decimation-refusal")).to_contain_text("2.5")
    assert testbed.client.config()["encoder"]["decimation"] == 1


def test_only_enter_sends(page: Page, testbed: Testbed) -> None:
    """A field that is left takes back what was not sent, and a click elsewhere sends nothing."""
    page.fill("#set-spring-stiffness-entry", "0.02")
    page.click("#trace")
    expect(page.locator("#set-spring-stiffness-entry")).to_have_value("0.012")
    assert testbed.client.config()["spring"]["stiffness"] == 0.012


def test_a_stop_takes_back_what_was_not_sent(page: Page, testbed: Testbed) -> None:
    before = testbed.client.experiment()["id"]
    page.fill("#set-spring-stiffness-entry", "0.02")
    page.keyboard.press("Escape")
    page.keyboard.press("Enter")
    expect(page.locator("#set-spring-stiffness-entry")).to_have_value("0.012")
    page.click("#to-release")
    page.fill("#release-deflection", "3")
    page.wait_for_timeout(1100)  # or it were the second Esc of an e-stop
    page.keyboard.press("Escape")
    page.keyboard.press("Enter")
    expect(page.locator("#release-deflection")).to_have_value("10.3")
    page.wait_for_timeout(300)
    assert testbed.client.config()["spring"]["stiffness"] == 0.012
    assert (testbed.state(), testbed.client.experiment()["id"]) == ("off", before)


def test_a_slider_that_is_held_through_a_stop_sends_nothing(page: Page, testbed: Testbed) -> None:
    box = page.locator("#set-spring-stiffness").bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + box["width"] * 0.41, middle)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 0.5, middle, steps=5)
    page.keyboard.press("Escape")
    expect(page.locator("#stop-answer")).to_contain_text("Stop: the daemon says off")
    page.mouse.move(box["x"] + box["width"] * 0.6, middle, steps=5)
    page.mouse.up()
    page.wait_for_timeout(300)
    assert testbed.client.config()["spring"]["stiffness"] == 0.012
    expect(page.locator("#set-spring-stiffness-entry")).to_have_value("0.012")
    page.mouse.down()  # and the next drag is one again
    page.mouse.move(box["x"] + box["width"] * 0.45, middle, steps=5)
    page.mouse.up()
    expect(page.locator("#set-spring-stiffness-confirmed")).not_to_have_text("0.012")


@pytest.mark.parametrize("level", ["1,5", "x", "", "2A"])
def test_a_trigger_level_that_cannot_be_read_changes_nothing(page: Page, level: str) -> None:
    page.select_option("#trigger-mode", "normal")
    enter(page, "#trigger-level", level)
    expect(page.locator("#trigger-refusal")).not_to_have_text("")


@pytest.mark.parametrize("text", ["2,5", "5mm", "", "nan", "0x10", "1_000"])
def test_the_server_asks_nothing_of_the_daemon_for_what_it_cannot_read(scope: Served, text: str) -> None:
    wait_for_config(scope)
    said = {"text": text, "unit": "ticks"}
    reply = scope.post("release", {"deflection": said, "duration_s": QUANTITY, "force": False})
    assert (reply.status_code, reply.json()["error"]["code"]) == (422, "quantity")
    assert [problem["key"] for problem in reply.json()["error"]["problems"]] == ["deflection"]
    reply = scope.post("set", {"settings": {"spring.stiffness": {**said, "unit": ""}}, "force": False})
    assert (reply.status_code, reply.json()["error"]["code"]) == (422, "quantity")


def wait_for_config(scope: Served) -> None:
    """The server knows the daemon's config while a page looks; here none does."""
    server = scope.server
    server.hub.config = server.hub._describe(0.0)
    server.lease.claim("a-page-of-the-tests", take_over=True)
