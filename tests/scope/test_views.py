"""The capture and the views over it: to look costs no row, and a file is seen in its own units and plane."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from hapticd.record import Run, read_run
from hapticd.record.schema import FLAG_MISSED_PERIOD
from tests.polling import wait_until

from .browser import Testbed
from .conftest import SIMULATED_MS
from .test_page import seen_rows, text
from .waiting import captures, drawn

SAVED_MS = 400_000
"""The server saves one file after another, and a simulation of a release may be before it."""


def save(page: Page, kind: str, path: Path) -> Path:
    page.click("#to-files")
    with page.expect_download(timeout=SAVED_MS) as found:
        page.click(f"#save-{kind}")
    found.value.save_as(path)
    return path


def open_file(page: Page, path: Path) -> None:
    page.click("#to-files")
    page.set_input_files("#open-file", path)
    expect(page.locator("#file-name")).to_contain_text(path.name)


def lost_ticks(run: Run) -> int:
    """Ticks that are not there and that the servo loop did not miss."""
    skipped = np.diff(run.columns["tick"]) - 1
    missed = (run.columns["flags"][1:] & FLAG_MISSED_PERIOD) != 0
    return int(skipped[~missed].sum())


def held(page: Page, run_file: Path) -> None:
    page.locator("body").press(" ")
    expect(page.locator("#run")).to_have_text("Run")


def dragged_back(page: Page, run_file: Path) -> None:
    box = page.locator(".lane .u-over").first.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 200, box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 300, box["y"] + 20, steps=4)
    page.mouse.up()
    expect(page.locator("#run")).to_have_text("Run")


def triggered(page: Page, run_file: Path) -> None:
    page.locator("body").press("t")
    page.select_option("#trigger-on", "release")


def opened(page: Page, run_file: Path) -> None:
    open_file(page, run_file)


@pytest.mark.parametrize("looked", [held, dragged_back, triggered, opened])
def test_looking_costs_no_row(
    page: Page, testbed: Testbed, tmp_path: Path, run_file: Path, looked: Callable[[Page, Path], None]
) -> None:
    wait_until(lambda: seen_rows(page) > 1900, "rows")
    page.select_option("#window", "10")
    looked(page, run_file)
    testbed.client.start()
    captures(page, 1500)
    testbed.client.stop()
    drawn(page)
    if text(page, "#run") == "Hold":
        page.click("#run")
    page.click("#run")
    page.select_option("#window", "10")
    drawn(page)
    page.click("#run")
    run = read_run(save(page, "arrow", tmp_path / "all.arrow"))
    assert run.rows > 3000
    assert lost_ticks(run) == 0


def test_the_hold_after_a_release_costs_no_row(page: Page, testbed: Testbed, tmp_path: Path) -> None:
    wait_until(lambda: seen_rows(page) > 1900, "rows")
    page.click("#to-release")
    page.fill("#release-deflection", "3")
    page.fill("#release-duration", "0.3")
    page.click("#release-form button")
    expect(page.locator("#hold-why")).to_contain_text("the release, taken as a single shot")
    captures(page, 1500)
    page.click("#run")
    page.select_option("#window", "10")
    drawn(page)
    page.click("#run")
    run = read_run(save(page, "arrow", tmp_path / "all.arrow"))
    assert run.rows > 3000
    assert lost_ticks(run) == 0


def test_what_is_held_stays_as_it_is(page: Page) -> None:
    wait_until(lambda: seen_rows(page) > 1900, "rows")
    page.locator("body").press(" ")
    page.mouse.move(5, 5)
    drawn(page)
    before = (seen_rows(page), text(page, "#value-position"))
    captures(page, 500)
    assert (seen_rows(page), text(page, "#value-position")) == before
    page.click("#run")
    wait_until(lambda: seen_rows(page) > 1900, "rows again")


def test_a_linear_run_beside_a_rotary_device(page: Page, linear_file: Path) -> None:
    heads = page.locator(".lane-head .unit")
    expect(heads.nth(0)).to_have_text("ticks of 0.000767 rad")
    for lane in ("velocity", "force"):
        page.check(f"#lane-{lane}")
    live_beta = text(page, "#beta")
    open_file(page, linear_file)
    expect(heads.nth(0)).to_have_text("ticks of 1e-5 m")
    expect(heads.nth(1)).to_contain_text("m/s, slope")
    expect(heads.nth(3)).to_have_text("N")
    expect(page.locator("#value-position")).to_contain_text(" m")
    expect(page.locator("#plane-of")).to_have_text("Of the run slide.arrow")
    expect(page.locator("#limit-velocity")).not_to_contain_text("rad")
    assert text(page, "#beta") != live_beta
    page.click("#to-measure")
    expect(page.locator("#m-pp")).to_contain_text(" m")
    page.click("#back")
    expect(heads.nth(0)).to_have_text("ticks of 0.000767 rad")
    expect(page.locator("#plane-of")).to_have_text("")
    assert text(page, "#beta") == live_beta


def test_a_setting_dragged_beside_a_file_is_seen_on_the_live_plane(page: Page, linear_file: Path) -> None:
    open_file(page, linear_file)
    page.click("#to-settings")
    box = page.locator("#set-spring-stiffness").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] * 0.41, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 0.6, box["y"] + box["height"] / 2, steps=5)
    expect(page.locator("#ghost-words")).to_contain_text("would land in")
    expect(page.locator("#plane-of")).to_have_text("")
    page.keyboard.press("Escape")
    page.mouse.up()
    expect(page.locator("#plane-of")).to_have_text("Of the run slide.arrow")


def test_a_file_without_a_config_has_counts_and_no_plane(page: Page, tmp_path: Path) -> None:
    path = tmp_path / "bare.csv"
    lines = ["time_s,encoder_counts,current_command_A", *(f"{i / 1000},{i * 7 % 50},0.1" for i in range(300))]
    path.write_text("\n".join(lines) + "\n")
    open_file(page, path)
    expect(page.locator(".lane-head .unit").first).to_have_text("ticks of 1 counts")
    expect(page.locator("#no-plane")).to_be_visible()
    expect(page.locator("#verdict")).to_be_hidden()


def test_missed_periods_in_a_release_are_told_at_its_residual(page: Page, testbed: Testbed) -> None:
    page.route("**/api/replay", lambda route: route.abort())  # after which it would say something else
    testbed.client.set({"encoder.decimation": 217})
    expect(page.locator("#set-encoder-decimation-confirmed")).to_have_text("217")
    page.click("#to-release")
    page.fill("#release-deflection", "10.3")
    page.fill("#release-duration", "4")
    page.click("#release-form button")
    wait_until(lambda: testbed.state() == "running", "a release")
    assert testbed.daemon is not None
    testbed.daemon.send_signal(signal.SIGSTOP)
    time.sleep(0.03)
    testbed.daemon.send_signal(signal.SIGCONT)
    expect(page.locator("#release-residual")).to_contain_text("missed, which the simulation kept", timeout=SIMULATED_MS)
    expect(page.locator("#note-residual")).to_contain_text("on it is of the timing, too")
    told = int(text(page, "#note-residual").split()[0])
    assert told >= 20
