"""A sequence from the page."""

from __future__ import annotations

from playwright.sync_api import Page, expect

from tests.polling import wait_until

from .browser import Testbed

TEXT = """
deflection: 30deg
duration_s: 0.4
steps:
  - {spring.stiffness: 0.01}
  - {spring.stiffness: 0.02, deflection: 500}
"""


def play(page: Page, text: str) -> None:
    page.click("#to-release")
    page.fill("#sequence-text", text)
    page.click("#sequence-form button")


def test_a_sequence_is_played_to_its_end(page: Page, testbed: Testbed) -> None:
    play(page, TEXT)
    expect(page.locator("#sequence-answer")).to_have_text("done: 2 of 2 releases")
    expect(page.locator("#sequence-runs li")).to_have_text(
        ["683 ticks, spring.stiffness = 0.01, decaying", "500 ticks, spring.stiffness = 0.02, decaying"]
    )
    expect(page.locator("#sequence-answer")).not_to_have_class("refusal")
    assert testbed.client.config()["spring"]["stiffness"] == 0.012
    assert testbed.state() == "off"


def test_what_is_wrong_in_it_is_said_and_nothing_moves(page: Page, testbed: Testbed) -> None:
    before = testbed.client.experiment()["id"]
    play(page, TEXT.replace("stiffness: 0.02", "stifness: 0.02"))
    expect(page.locator("#sequence-answer")).to_contain_text("did you mean spring.stiffness?")
    assert (testbed.state(), testbed.client.experiment()["id"]) == ("off", before)


def test_a_step_that_is_refused_has_remedies_in_its_own_unit(page: Page, testbed: Testbed) -> None:
    steps = ["steps:", "  - {}  # as it is", "  - {encoder.decimation: 217, servo.rate_hz: 100, deflection: 200deg}"]
    before = testbed.client.experiment()["id"]
    play(page, "\n".join(["repeat: 2", "duration_s: 0.4", *steps]))
    answer = page.locator("#sequence-answer")
    expect(answer).to_contain_text("step 2: ")
    expect(answer).to_contain_text("nothing is started or changed")
    expect(answer.locator("li", has_text="deflection")).to_contain_text("deflection 200 → ")
    answer.locator("button.apply[data-key='servo.rate_hz']").click()
    expect(answer).to_contain_text("sequence tries again")
    text = page.locator("#sequence-text").input_value()
    assert "{}  # as it is" in text
    assert "servo.rate_hz: 100," not in text
    assert (testbed.state(), testbed.client.experiment()["id"]) == ("off", before)
    page.click("#sequence-form button")
    expect(answer).to_have_text("done: 4 of 4 releases")


def test_a_duration_beyond_the_limit_is_refused_in_a_sentence(page: Page, testbed: Testbed) -> None:
    play(page, TEXT.replace("0.4", "1e9"))
    expect(page.locator("#sequence-answer")).to_have_text(
        "steps: step 1: duration_s should be above 0 and at most 3600 s, not 1000000000"
    )


def test_a_stop_ends_it(page: Page, testbed: Testbed) -> None:
    play(page, TEXT.replace("0.4", "20"))
    wait_until(lambda: testbed.state() == "running", "the first release")
    page.keyboard.press("Escape")
    expect(page.locator("#sequence-answer")).to_have_text("aborted: 1 of 2 releases")
    page.wait_for_timeout(500)
    assert testbed.state() == "off"
