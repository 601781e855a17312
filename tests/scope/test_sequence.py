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
    assert testbed.client.config()["spring"]["stiffness"] == 0.012
    assert testbed.state() == "off"


def test_what_is_wrong_in_it_is_said_and_nothing_moves(page: Page, testbed: Testbed) -> None:
    before = testbed.client.experiment()["id"]
    play(page, TEXT.replace("stiffness: 0.02", "stifness: 0.02"))
    expect(page.locator("#sequence-answer")).to_contain_text("did you mean spring.stiffness?")
    assert (testbed.state(), testbed.client.experiment()["id"]) == ("off", before)


def test_a_stop_ends_it(page: Page, testbed: Testbed) -> None:
    play(page, TEXT.replace("0.4", "20"))
    wait_until(lambda: testbed.state() == "running", "the first release")
    page.keyboard.press("Escape")
    expect(page.locator("#sequence-answer")).to_have_text("aborted: 1 of 2 releases")
    page.wait_for_timeout(500)
    assert testbed.state() == "off"
