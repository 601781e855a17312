"""A release in which periods were missed, beside a simulation that ticks when the loop did."""

from __future__ import annotations

import os
import signal
import time

import pytest
from playwright.sync_api import Page, expect

from hapticd.scope import runs
from hapticd.scope.runs import RunError
from tests.polling import wait_until

from .browser import Testbed
from .conftest import SIMULATED_MS
from .test_page import text

STALLS, STALL_S, BETWEEN_S = 6, 0.006, 0.008


def test_missed_periods_are_replayed(page: Page, testbed: Testbed) -> None:
    assert testbed.daemon is not None
    page.click("#to-release")
    page.fill("#release-deflection", "60deg")
    page.fill("#release-duration", "1")
    page.click("#release-form button")
    wait_until(lambda: testbed.state() == "running", "the release")
    for _ in range(STALLS):
        os.kill(testbed.daemon.pid, signal.SIGSTOP)
        time.sleep(STALL_S)
        os.kill(testbed.daemon.pid, signal.SIGCONT)
        time.sleep(BETWEEN_S)
    expect(page.locator("#release-residual")).to_contain_text(
        "the simulation ticks when the loop did", timeout=SIMULATED_MS
    )
    found = text(page, "#release-residual").split()
    assert int(text(page, "#release-residual").split(";")[-1].split()[0]) >= STALLS
    assert float(found[1]) < 12.0
    expect(page.locator("#note-residual")).to_contain_text("the simulation ticks when the loop did")


@pytest.mark.parametrize("name", ["simulate", "replay"])
def test_who_cannot_have_a_replay_is_told_so(page: Page, testbed: Testbed, name: str) -> None:
    """Where the server has none the page says that the simulation kept every period, or that there is none."""
    assert testbed.daemon is not None
    page.route(f"**/api/{name}", lambda route: route.abort())
    page.click("#to-release")
    page.fill("#release-deflection", "60deg")
    page.fill("#release-duration", "0.5")
    page.click("#release-form button")
    wait_until(lambda: testbed.state() == "running", "the release")
    os.kill(testbed.daemon.pid, signal.SIGSTOP)
    time.sleep(2 * STALL_S)
    os.kill(testbed.daemon.pid, signal.SIGCONT)
    if name == "replay":
        expect(page.locator("#release-residual")).to_contain_text("which the simulation kept", timeout=SIMULATED_MS)
    else:
        expect(page.locator("#release-residual")).to_contain_text("the simulation ticks when", timeout=SIMULATED_MS)


def test_a_simulation_may_use_the_processor_for_so_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "SIMULATION_CPU_S", 1)
    with pytest.raises(RunError, match="longer than 1 s of processor time"):
        runs.simulate_release({"servo": {"rate_hz": 20_000}}, 10, runs.LONGEST_SIMULATION_S)
