"""The (K, B) map beside the (β, σ) plane: what can be rendered, and both dragged at once."""

from __future__ import annotations

import itertools

from playwright.sync_api import Page, expect

from hapticd.config import load_config
from hapticd.scope.theory import z_map

from .browser import Testbed

WORKED_OUT_MS = 240_000


def opened(page: Page) -> dict[str, float]:
    page.click("#to-zmap")
    expect(page.locator("#plane")).to_be_hidden()
    page.locator("#zmap-point").wait_for(timeout=WORKED_OUT_MS)
    box = page.locator("#zmap").bounding_box()
    assert box is not None
    return dict(box)


def drag(page: Page, box: dict[str, float], x: float, y: float) -> None:
    """Press in the corner, and move to a place that is given in parts of the map."""
    page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + 0.8 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + x * box["width"], box["y"] + y * box["height"], steps=4)


def test_it_is_of_the_device_and_not_of_its_spring() -> None:
    document = load_config("re35").model_dump(mode="json")
    found = z_map(document, 0.0)
    assert z_map({**document, "spring": {**document["spring"], "stiffness": 0.4, "damping": 1e-4}}, 0.0) is found
    assert len(found["outcome"]) == len(found["damping"]) == len(found["exact"])
    assert {len(column) for column in found["outcome"]} == {len(found["stiffness"])}
    assert max(found["exact"]) > 10 * found["exact"][0] > 0.0  # damping is what makes it wide


def test_both_are_dragged_at_once(page: Page, testbed: Testbed) -> None:
    box = opened(page)
    labels = [each.bounding_box() for each in page.locator("#zmap text[text-anchor=middle]:not(.axis)").all()]
    edges = sorted((each["x"], each["x"] + each["width"]) for each in labels if each)
    assert len(edges) >= 2
    assert all(right < left for (_, right), (left, _) in itertools.pairwise(edges))
    expect(page.locator("#zmap-words")).to_have_text("K = 0.012 N m/rad, B = 0 N m s/rad: calm in the worst of hands")
    drag(page, box, 0.35, 0.75)
    expect(page.locator("#zmap-ghost")).to_be_attached()
    expect(page.locator("#ghost-words")).to_contain_text("would land in")
    assert testbed.client.config()["spring"]["damping"] == 0
    page.mouse.up()
    expect(page.locator("#set-spring-damping-confirmed")).not_to_have_text("0")
    spring = testbed.client.config()["spring"]
    assert spring["damping"] > 0.0
    assert spring["stiffness"] != 0.012
    expect(page.locator("#zmap-words")).to_contain_text(f"K = {spring['stiffness']:g} N m/rad")
    expect(page.locator("#zmap-ghost")).to_have_count(0)
    page.click("#to-zmap")
    expect(page.locator("#plane")).to_be_visible()
    expect(page.locator("#zmap-words")).to_have_text("")  # it is told while it is looked at, and no longer


def test_a_stop_takes_it_out_of_the_hand(page: Page, testbed: Testbed) -> None:
    box = opened(page)
    before = testbed.client.config()["spring"]
    drag(page, box, 0.6, 0.3)
    expect(page.locator("#zmap-ghost")).to_be_attached()
    page.keyboard.press("Escape")
    expect(page.locator("#stop-answer")).to_contain_text("Stop: the daemon says off")
    expect(page.locator("#zmap-ghost")).to_have_count(0)
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    page.mouse.up()
    expect(page.locator("#zmap-ghost")).to_have_count(0)
    assert testbed.client.config()["spring"] == before
