"""Excitations and limits from the page: amplitude, duration, frequencies, guard and passivity."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from hapticd.record import read_run
from hapticd.record.schema import FLAG_EXCITATION
from tests.polling import wait_until

from .browser import Testbed


def fill(page: Page, **numbers: str) -> None:
    for name, text in numbers.items():
        page.fill(f"#excite-{name}", text)


def choose(page: Page, shape: str) -> None:
    page.click("#to-release")
    page.select_option("#excite-name", shape)


def enter(page: Page, key: str, text: str) -> None:
    page.fill(f"#set-safety-{key}", text)
    page.press(f"#set-safety-{key}", "Enter")


def test_a_chirp_is_played_as_it_was_typed(page: Page, testbed: Testbed) -> None:
    choose(page, "chirp")
    expect(page.locator("#excite-for-amplitude .unit")).to_have_text("A")
    fill(page, amplitude="100mA", duration_s="1", low_hz="2", high_hz="0.05kHz")
    page.click("#excite-form button")
    expect(page.locator("#excite-answer")).to_contain_text("1 s, recorded to")
    before = page.locator("#excite-answer").inner_text()
    wait_until(lambda: testbed.client.experiment()["state"] == "done", "the end of the chirp")
    run = read_run(Path(before.partition("recorded to ")[2]))
    played = (run.columns["flags"] & FLAG_EXCITATION) != 0
    assert played.sum() == pytest.approx(1000, abs=60)
    added = run.columns["current_command_A"] - run.columns["force_command"] / 0.0292
    assert 0.08 < np.abs(added[played]).max() < 0.11
    late = added[played][-500:]  # from half way on: a logarithmic chirp from 2 to 50 Hz is above 10 Hz there
    assert np.count_nonzero(np.diff(np.sign(late))) > 10
    assert testbed.state() == "off"


def test_each_shape_has_its_own_fields(page: Page) -> None:
    choose(page, "all")
    for name in ("amplitude", "duration_s", "low_hz", "high_hz"):
        expect(page.locator(f"#excite-for-{name}")).to_be_hidden()
    choose(page, "sweep")
    expect(page.locator("#excite-for-amplitude .unit")).to_have_text("rad")
    expect(page.locator("#excite-for-low_hz")).to_be_hidden()
    expect(page.locator("#excite-summary")).to_contain_text("friction curve")


@pytest.mark.parametrize(
    ("field", "text"),
    [("amplitude", "2,5"), ("amplitude", "3deg"), ("duration_s", ""), ("low_hz", "-1"), ("high_hz", "fast")],
)
def test_what_cannot_be_read_is_refused_at_its_field(page: Page, testbed: Testbed, field: str, text: str) -> None:
    before = testbed.client.experiment()["id"]
    choose(page, "chirp")
    fill(page, **{field: text})
    page.click("#excite-form button")
    expect(page.locator(f"#excite-{field}-refusal")).not_to_have_text("")
    assert (testbed.state(), testbed.client.experiment()["id"]) == ("off", before)


def test_what_is_beyond_a_limit_is_refused_with_it(page: Page, testbed: Testbed) -> None:
    choose(page, "chirp")
    fill(page, high_hz="400")
    page.click("#excite-form button")
    expect(page.locator("#excite-answer")).to_contain_text("must be at most 250 Hz")
    assert testbed.state() == "off"


def test_limits_guard_and_passivity(page: Page, testbed: Testbed) -> None:
    page.click("#limits summary")
    enter(page, "max_velocity", "300")
    expect(page.locator("#set-safety-max_velocity-confirmed")).to_have_text("300")
    enter(page, "max_excursion", "90deg")
    expect(page.locator("#set-safety-max_excursion-confirmed")).to_have_text("1.571")
    enter(page, "soft_start_s", "100ms")
    expect(page.locator("#set-safety-soft_start_s-confirmed")).to_have_text("0.1")
    enter(page, "encoder_jump", "2,5")
    expect(page.locator("#set-safety-encoder_jump-refusal")).not_to_have_text("")
    page.select_option("#set-safety-passivity", "observe")
    expect(page.locator("#set-safety-passivity-confirmed")).to_have_text("observe")
    enter(page, "max_velocity", "0")
    expect(page.locator("#set-safety-max_velocity-confirmed")).to_have_text("no limit")
    expect(page.locator("#limits-off")).to_contain_text("safety.max_velocity")
    safety = testbed.client.config()["safety"]
    assert (safety["max_velocity"], safety["passivity"], safety["encoder_jump"]) == (None, "observe", 8192)
    testbed.client.set({"safety.max_excursion": 10, "safety.soft_start_s": 0.25, "safety.passivity": "off"})
    testbed.client.set({"safety.max_velocity": 400})
    expect(page.locator("#limits-off")).not_to_contain_text("safety")
