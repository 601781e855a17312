"""The X–Y lane: force over position with the ideal spring, the phase plane, and the releases before."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from tests.polling import wait_until

from .browser import Testbed

CURVES = """async ([config, counts, forces]) => {
    const { curve, idealSpring } = await import("/static/js/xy.js");
    const { placeUnits } = await import("/static/js/source.js");
    const { Store } = await import("/static/js/store.js");
    const store = new Store(1 << 16);
    store.rawResolution = 2 * Math.PI / 8192;
    counts.forEach((count, row) => {
        store.counts[row] = count;
        store.channels.force.values[row] = forces[row];
        store.flags[row] = 1;
    });
    store.head = counts.length;
    const scales = { resolution: 217 * store.rawResolution };
    const source = { name: "", store, config, units: { position: "rad" }, scales };
    const units = placeUnits(source);
    const found = curve(source, 0, store.head, "force", units.ticks);
    const ideal = idealSpring(config, -3, 5, units.ticks);
    const list = (each) => [Array.from(each.x), Array.from(each.y)];
    return [units, list(found), list(ideal)];
}"""


ENTER_AND_WHEEL = """() => {
    const enter = new KeyboardEvent("keydown", { key: "Enter" });
    document.querySelector("#y-largest-xy").dispatchEvent(enter);
    const canvas = document.querySelector("#xy-canvas");
    const { top, height } = canvas.getBoundingClientRect();
    canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: 100, clientY: top + height / 2, cancelable: true }));
}"""


def release(page: Page, deflection: str) -> None:
    page.click("#to-release")
    page.fill("#release-deflection", deflection)
    page.fill("#release-duration", "0.5")
    page.click("#release-form button")
    expect(page.locator("#release-outcome")).not_to_have_text("")


def points(page: Page) -> int:
    return int(page.locator("#xy-canvas").get_attribute("data-points") or 0)


@pytest.mark.parametrize(
    ("side", "pushes"), [("both", (True, True)), ("positive", (False, True)), ("negative", (True, False))]
)
def test_curves(page: Page, side: str, pushes: tuple[bool, bool]) -> None:
    config = {"spring": {"stiffness": 0.5, "side": side}}
    counts, forces = [-217, 0, 434], [0.25, 0.0, -0.5]
    units, found, ideal = page.evaluate(CURVES, [config, counts, forces])
    tick = 217 * 2 * np.pi / 8192
    assert units == {"ticks": pytest.approx(tick), "rad": 1, "deg": pytest.approx(np.pi / 180)}
    np.testing.assert_allclose(found, [[-1, 0, 2], forces], atol=1e-6)
    expected = [3 * tick * 0.5 * pushes[0], 0, -5 * tick * 0.5 * pushes[1]]
    np.testing.assert_allclose(ideal, [[-3, 0, 5], expected], atol=1e-12)


def test_a_release_over_the_ideal_spring(page: Page, testbed: Testbed) -> None:
    testbed.client.set({"encoder.decimation": 217, "servo.rate_hz": 500})
    expect(page.locator("#set-servo-rate_hz-confirmed")).to_have_text("500")
    page.check("#lane-xy")
    expect(page.locator("#xy-words")).to_have_text("the spring is not rendered in this window")
    release(page, "10.3")
    expect(page.locator("#hold-why")).to_contain_text("the release")
    wait_until(lambda: points(page) > 100, "the release in the X-Y lane")
    expect(page.locator("#xy-words")).to_have_text("in N m over ticks")
    expect(page.locator("#xy-canvas")).to_have_attribute("data-before", "0")
    page.select_option("#xy-unit", "deg")
    page.select_option("#xy-kind", "phase")
    expect(page.locator("#xy-words")).to_have_text("in deg/s over deg")
    release(page, "6")
    expect(page.locator("#xy-canvas")).to_have_attribute("data-before", "1")
    least, largest, auto = (page.locator(f"#xy {each}") for each in ("#y-least-xy", "#y-largest-xy", ".y-auto"))
    least.fill("-2000")
    largest.fill("2000")
    page.evaluate(ENTER_AND_WHEEL)  # before the next frame is drawn
    ends = "document.querySelector('#y-largest-xy').value - document.querySelector('#y-least-xy').value"
    span = partial(page.evaluate, ends)
    assert span() == pytest.approx(5000, rel=1e-3)
    expect(auto).to_have_attribute("aria-pressed", "false")
    box = page.locator("#xy-canvas").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 200, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + 200, box["y"] + box["height"] / 2 + 20, steps=3)
    page.mouse.up()
    wait_until(lambda: float(largest.input_value()) > 2550, "a range that was moved")
    assert span() == pytest.approx(5000, rel=1e-2)
    page.select_option("#xy-kind", "force")
    expect(largest).to_have_value("")  # of each plane its own
    page.select_option("#xy-kind", "phase")
    expect(largest).not_to_have_value("")
    page.mouse.dblclick(box["x"] + 200, box["y"] + 40)
    expect(auto).to_have_attribute("aria-pressed", "true")
    drawn = page.evaluate(
        """() => {
            const canvas = document.querySelector("#xy-canvas");
            const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
            return pixels.filter((value, i) => i % 4 === 3 && value > 0).length;
        }"""
    )
    assert drawn > 1000
    page.uncheck("#lane-xy")
    expect(page.locator("#xy")).to_be_hidden()
