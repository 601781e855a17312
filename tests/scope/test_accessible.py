"""The page for those who use no mouse, and axe-core's rules in every panel, light and dark, wide and on a phone."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from tests.installing import one_at_a_time
from tests.polling import wait_until

from .browser import ROOT, Testbed
from .conftest import Open
from .test_views import open_file

AXE = "axe-core@4.14.1"
FOLDER = ROOT / ".venv" / "axe"
TABS = ("settings", "release", "notes", "measure", "health", "files")
SERIOUS = ("serious", "critical")


@pytest.fixture(scope="module")
def axe() -> str:
    """The source of axe-core, from the npm registry; skipped, with the reason, where that cannot be had."""
    path = FOLDER / "node_modules" / "axe-core" / "axe.min.js"
    with one_at_a_time():
        if not path.exists():
            if not shutil.which("npm"):
                pytest.skip(f"no npm to install {AXE} with")
            words = ["npm", "install", "--silent", "--no-audit", "--no-fund", "--prefix", str(FOLDER), AXE]
            subprocess.run(words, check=False, timeout=300, stdout=subprocess.DEVNULL)
    if not path.exists():
        pytest.skip(f"{AXE} could not be installed")
    return path.read_text(encoding="utf-8")


def findings(page: Page, axe: str) -> list[str]:
    """What is serious or worse: rule, element, why."""
    page.evaluate(axe)
    found: list[dict[str, Any]] = page.evaluate("async () => (await axe.run(document)).violations")
    return [
        f"{rule['id']} ({rule['impact']}): {node['html'][:120]}: {node['failureSummary'].splitlines()[-1].strip()}"
        for rule in found
        if rule["impact"] in SERIOUS
        for node in rule["nodes"]
    ]


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [(1400, 900), (390, 844)])
def test_no_panel_has_a_serious_finding(
    page: Page, testbed: Testbed, axe: str, run_file: Path, scheme: Any, size: tuple[int, int]
) -> None:
    page.emulate_media(color_scheme=scheme)
    page.set_viewport_size({"width": size[0], "height": size[1]})
    wrong = []
    for tab in TABS:
        page.click(f"#to-{tab}")
        if tab == "settings":
            page.click("#limits summary")
        wrong += [f"{tab}: {each}" for each in findings(page, axe)]
    page.click("#to-zmap")
    expect(page.locator("#zmap")).to_be_visible()
    wrong += [f"map: {each}" for each in findings(page, axe)]
    page.click("#to-zmap")
    # the page as it is with refusals, each with its question open
    refused = "encoder.decimation: 217, servo.rate_hz: 100, deflection: 200deg"
    page.click("#to-release")
    page.fill("#sequence-text", f"steps: [{{{refused}}}]")
    page.click("#sequence-form button")
    page.click("#sequence-answer button.force")
    wrong += [f"sequence: {each}" for each in findings(page, axe)]
    page.click("#to-settings")
    page.fill("#set-spring-stiffness-entry", "400")
    page.press("#set-spring-stiffness-entry", "Enter")
    page.click("#set-spring-stiffness-refusal button.force")
    wrong += [f"refusal: {each}" for each in findings(page, axe)]
    page.locator("#lane-xy").set_checked(True)
    wrong += [f"X-Y: {each}" for each in findings(page, axe)]
    page.click("#help")
    wrong += [f"keys: {each}" for each in findings(page, axe)]
    page.click("#keys button.close")
    open_file(page, run_file)
    wrong += [f"file: {each}" for each in findings(page, axe)]
    page.click("#back")
    testbed.client.estop()
    expect(page.locator("#banner-title")).to_be_visible()
    wrong += [f"fault: {each}" for each in findings(page, axe)]
    assert not wrong, "\n".join(sorted(set(wrong)))


def tab_to(page: Page, selector: str, most: int = 120) -> None:
    """Press Tab until an element has the focus."""
    for _ in range(most):
        if page.evaluate("selector => document.activeElement?.matches(selector) ?? false", selector):
            return
        page.keyboard.press("Tab")
    pytest.fail(f"Tab does not reach {selector}")


def test_a_session_without_a_mouse(open_page: Open, testbed: Testbed) -> None:
    page = open_page()
    if page.locator("body").get_attribute("data-control") != "mine":
        tab_to(page, "#take")
        page.keyboard.press("Enter")
    expect(page.locator("#lease")).to_have_text("this page has the controls")
    tab_to(page, "#lane-velocity")
    page.keyboard.press("Space")
    expect(page.locator("#value-velocity")).to_be_visible()
    tab_to(page, "#place-unit")
    page.keyboard.press("r")  # rad
    expect(page.locator(".lane-head .unit").first).to_have_text("rad")
    tab_to(page, "#y-least-position")
    page.keyboard.type("-1")
    page.keyboard.press("Tab")
    page.keyboard.type("1")
    page.keyboard.press("Enter")
    expect(page.locator('section[aria-label="Position"] .y-auto')).to_have_attribute("aria-pressed", "false")
    tab_to(page, "#to-settings")
    tab_to(page, "#start")
    page.keyboard.press("Enter")
    wait_until(lambda: testbed.state() == "running", "a start by the keyboard")
    page.keyboard.press("m")
    wait_until(lambda: len(testbed.client.status()["recorder"]["notes"]) == 1, "a marker")
    page.keyboard.press("Escape")
    wait_until(lambda: testbed.state() == "off", "a stop by the keyboard")
    page.wait_for_timeout(1100)
    tab_to(page, "#to-settings")
    page.keyboard.press("ArrowRight")
    expect(page.locator("#tab-release")).to_be_visible()
    tab_to(page, "#release-deflection")
    page.keyboard.press("Control+a")
    page.keyboard.type("30deg")
    tab_to(page, "#release-duration")
    page.keyboard.press("Control+a")
    page.keyboard.type("800ms")
    page.keyboard.press("Enter")
    expect(page.locator("#release-answer")).to_contain_text("released from 683")
    expect(page.locator("#release-outcome")).to_contain_text("decaying")
    tab_to(page, "#to-release")
    for _ in range(4):
        page.keyboard.press("ArrowRight")
    expect(page.locator("#tab-files")).to_be_visible()
    with page.expect_download() as found:
        tab_to(page, "#save-svg")
        page.keyboard.press("Enter")
    assert found.value.suggested_filename.endswith(".svg")
