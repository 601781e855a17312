"""One browser and one testbed for all tests of the page; every test gets it off, without a fault, at its first settings."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml
from playwright.sync_api import Browser, ConsoleMessage, Page, expect

from hapticd.cli.main import main
from hapticd.client import Client
from hapticd.scope.lease import Lease
from tests.service import fake_control
from tests.service.fake_control import FakeControl

from .browser import Testbed, launched
from .served import Served, serve

SETTINGS = {
    "safety.guard": "refuse",
    "spring.stiffness": 0.012,
    "spring.damping": 0,
    "encoder.decimation": 1,
    "servo.rate_hz": 1000,
    "delay.computation_s": 0,
    "dither.target": "none",
    "spring.side": "both",
    "safety.max_velocity": 400,
}
WIDTH, HEIGHT = 1280, 720
PATIENCE_MS = 120_000
SIMULATED_MS = 900_000
"""For what a process at low priority works out: beside other tests it has a twentieth of a processor."""
TEST_S = 1800
"""For one test: it ends what hangs, and no page that a busy machine is slow with."""
Open = Callable[..., Page]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give every test of this folder the time that its waits may take."""
    for item in items:
        if item.path.is_relative_to(Path(__file__).parent) and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(TEST_S))


@dataclass(frozen=True)
class Stage:
    """A scope in front of a stand-in for the daemon."""

    control: FakeControl
    client: Client
    scope: Served


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    path, control = tmp_path_factory.mktemp("stage") / "h.sock", FakeControl()
    with fake_control.serve(control, path) as client, serve(path) as served:
        yield Stage(control, client, served)


@pytest.fixture
def control(stage: Stage) -> FakeControl:
    """The stand-in, as at its start."""
    fake_control.renew(stage.control, stage.client)
    return stage.control


@pytest.fixture
def scope(stage: Stage, control: FakeControl) -> Served:
    """The scope, with its controls free."""
    stage.scope.server.lease = Lease()
    return stage.scope


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    """Chromium; while it is there, so is Playwright's event loop, in which other packages' tests could not run their own."""
    expect.set_options(timeout=PATIENCE_MS)
    with launched() as browser:
        yield browser


@pytest.fixture(scope="package")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Testbed]:
    """A daemon and a scope."""
    testbed = Testbed(tmp_path_factory.mktemp("scope"))
    try:
        testbed.start_daemon()
        testbed.start_scope()
        yield testbed
    finally:
        testbed.close()


@pytest.fixture
def testbed(shared: Testbed) -> Testbed:
    """The same, as at its start."""
    client = shared.client
    if client.status()["state"] == "fault":
        client.clear()
    client.stop()
    # A fault leaves the shaft where it coasted to; the spring begins there.
    here = client.status()["encoder_counts"] * 2 * math.pi / client.config()["encoder"]["counts_per_rev"]
    client.set({**SETTINGS, "spring.origin": here})
    return shared


@pytest.fixture
def open_page(browser: Browser, testbed: Testbed) -> Iterator[Open]:
    """Open the page in a context of its own; an error or a breach of the content policy in it fails the test."""
    contexts, wrong = [], []

    def hear(message: ConsoleMessage) -> None:
        if (
            message.type == "error"
            and "Failed to load resource" not in message.text
            and "WebSocket" not in message.text
        ):
            wrong.append(message.text)

    def open_one(url: str | None = None, *, ready: bool = True, before: Callable[[Page], None] | None = None) -> Page:
        context = browser.new_context(viewport={"width": WIDTH, "height": HEIGHT}, accept_downloads=True)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.on("console", hear)
        page.on("pageerror", lambda error: wrong.append(str(error)))
        if before is not None:
            before(page)
        page.goto(url or testbed.url)
        if ready:
            expect(page.locator("#region")).not_to_have_text("–")
        return page

    yield open_one
    for context in contexts:
        context.close()
    assert wrong == []


@pytest.fixture
def page(open_page: Open) -> Page:
    """The page with the controls."""
    page = open_page()
    if page.locator("body").get_attribute("data-control") != "mine":
        page.click("#take")
    expect(page.locator("#lease")).to_have_text("this page has the controls")
    return page


@pytest.fixture
def run_file(tmp_path: Path) -> Path:
    """A run of 0.5 s at 2 kHz, simulated."""
    path = tmp_path / "sim.arrow"
    settings = ["--set", "servo.rate_hz=2000", "--set", "encoder.decimation=217"]
    assert main(["simulate", "--duration", "0.5", "--deflection", "12", *settings, "-o", str(path)]) == 0
    return path


@pytest.fixture
def linear_file(tmp_path: Path) -> Path:
    """A run of a linear device, simulated."""
    config = tmp_path / "slide.yaml"
    config.write_text(
        yaml.safe_dump(
            {
                "encoder": {"counts_per_metre": 1e5},
                "spring": {"stiffness": 300.0},
                "plant": {"inertia": 0.1, "viscous": 1.0, "coulomb": 0.5},
                "amplifier": {"torque_constant": 2.0},
            }
        )
    )
    path = tmp_path / "slide.arrow"
    assert main(["simulate", str(config), "--duration", "0.4", "--deflection", "50", "-o", str(path)]) == 0
    return path
