"""A refusal in the page: a list of what would help with a button behind each, and Force behind a question."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Page, expect

from hapticd.scope.choices import in_asked_unit
from tests.config.test_units import LINEAR, ROTARY
from tests.polling import wait_until

from .browser import Testbed

CASE_D = {"encoder.decimation": 217, "servo.rate_hz": 100}


def refused_release(page: Page, testbed: Testbed, deflection: str) -> None:
    testbed.client.set(CASE_D)
    expect(page.locator("#set-servo-rate_hz-confirmed")).to_have_text("100")
    page.click("#to-release")
    page.fill("#release-deflection", deflection)
    page.fill("#release-duration", "0.5")
    page.click("#release-form button")
    expect(page.locator("#release-answer")).to_contain_text("nothing is started or changed")


@pytest.mark.parametrize(("deflection", "unit"), [("20.3", "ticks"), ("200deg", "deg")])
def test_a_release_that_is_refused_is_a_list_in_the_asked_unit(
    page: Page, testbed: Testbed, deflection: str, unit: str
) -> None:
    refused_release(page, testbed, deflection)
    answer = page.locator("#release-answer")
    items = answer.locator("li")
    assert items.count() >= 3
    assert items.count() - 1 <= answer.locator("button.apply").count() <= items.count()
    gentler = answer.locator("li", has_text="deflection")
    number = deflection.removesuffix(unit)
    expect(gentler).to_contain_text(re.compile(rf"deflection {re.escape(number)} → [\d.]{{1,5}} {unit}:"))
    said = answer.inner_text()
    assert "--" not in said
    assert "API" not in said
    assert not re.search(r"\d\.\d{7}", said)


def test_apply_puts_the_deflection_into_its_field_and_starts_nothing(page: Page, testbed: Testbed) -> None:
    refused_release(page, testbed, "200deg")
    page.click("button.apply[data-key=deflection]")
    field = page.locator("#release-deflection")
    expect(field).to_have_value(re.compile(r"^[\d.]+deg$"))
    expect(page.locator("#release-answer")).to_contain_text("Release tries again")
    assert testbed.state() == "off"
    page.click("#release-form button")
    expect(page.locator("#release-outcome")).to_contain_text(re.compile("decaying|monotone"))


def test_apply_changes_the_setting_and_starts_nothing(page: Page, testbed: Testbed) -> None:
    refused_release(page, testbed, "20.3")
    page.click("button.apply[data-key='servo.rate_hz']")
    expect(page.locator("#release-answer")).to_contain_text("Release tries again")
    assert testbed.client.config()["servo"]["rate_hz"] > 100
    assert testbed.state() == "off"
    page.click("#release-form button")
    expect(page.locator("#release-outcome")).to_contain_text(re.compile("decaying|monotone|persistent"))


def test_force_is_asked_for_twice_and_a_stop_takes_the_question_back(page: Page, testbed: Testbed) -> None:
    before = testbed.client.experiment()["id"]
    refused_release(page, testbed, "20.3")
    page.click("#release-answer button.force")
    yes = page.locator("#release-answer button.force-yes")
    expect(yes).to_have_text("Force: a release from 20.3 ticks for 0.5 s")
    assert testbed.client.experiment()["id"] == before
    page.keyboard.press("Escape")
    expect(yes).to_be_hidden()
    page.click("#release-answer button.force")
    page.click("#release-answer button.force-no")
    expect(yes).to_be_hidden()
    assert testbed.client.experiment()["id"] == before
    page.click("#release-answer button.force")
    yes.click()
    expect(page.locator("#release-outcome")).not_to_have_text("")
    assert testbed.client.experiment()["id"] == before + 1


def test_what_was_refused_goes_when_something_else_is_typed(page: Page, testbed: Testbed) -> None:
    refused_release(page, testbed, "20.3")
    page.fill("#release-deflection", "20.2")
    expect(page.locator("#release-answer")).to_have_text("")


def test_a_setting_that_is_refused_is_applied_together_with_what_helps(page: Page, testbed: Testbed) -> None:
    page.fill("#set-spring-stiffness-entry", "40")
    page.press("#set-spring-stiffness-entry", "Enter")
    refusal = page.locator("#set-spring-stiffness-refusal")
    expect(refusal).to_contain_text("nothing is started or changed")
    refusal.locator("button.apply[data-key='spring.stiffness']").click()
    expect(refusal).to_have_text("")
    assert 0.012 < testbed.client.config()["spring"]["stiffness"] < 40
    page.fill("#set-spring-stiffness-entry", "40")
    page.press("#set-spring-stiffness-entry", "Enter")
    refusal.locator("button.force").click()
    refusal.locator("button.force-yes").click()
    expect(page.locator("#set-spring-stiffness-confirmed")).to_have_text("40")


def test_origin_here(page: Page, testbed: Testbed) -> None:
    client = testbed.client
    client.set({"spring.origin": client.config()["spring"]["origin"] + 40.0})
    page.click("#start")
    answer = page.locator("#command-answer")
    expect(answer).to_contain_text("beyond safety.max_excursion")
    assert "hapticd" not in answer.inner_text()
    answer.locator("button.apply").click()
    expect(answer).to_contain_text("start tries again")
    assert abs(client.status()["position_ticks"]) < 1
    client.set({"spring.origin": client.config()["spring"]["origin"] + 40.0})
    page.click("#origin")
    expect(answer).to_contain_text("where the shaft is")
    assert abs(client.status()["position_ticks"]) < 1
    page.click("#start")
    wait_until(lambda: testbed.state() == "running", "a start")


@pytest.mark.parametrize(
    ("text", "after_ticks", "shown"),
    [("-217counts", -0.25, -54.2), ("20.3", 2.5, 2.5), ("20.3ticks", 2.49999999999, 2.5)],
)
def test_a_gentler_release_is_rounded_to_the_safe_side(text: str, after_ticks: float, shown: float) -> None:
    remedy = {"key": "deflection", "before": 1.0, "after": after_ticks, "unit": "ticks"}
    found = in_asked_unit({"remedies": [remedy]}, {"text": text, "unit": "ticks"}, ROTARY)["remedies"][0]
    assert found["after"] == shown


def test_other_remedies_are_left_alone() -> None:
    remedy = {"key": "servo.rate_hz", "before": 1.0, "after": 2.0, "unit": "Hz"}
    assert in_asked_unit({"remedies": [remedy]}, {"text": "2mm", "unit": "ticks"}, LINEAR)["remedies"] == [remedy]
