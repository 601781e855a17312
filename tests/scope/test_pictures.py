"""Pictures for a lab book; axes in the unit that is chosen, with a range that is typed, zoomed and dragged."""

from __future__ import annotations

import re
import struct
from datetime import UTC, datetime
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from playwright.sync_api import Page, expect

from hapticd.record import read_run
from tests.polling import wait_until

from .browser import Testbed
from .conftest import SIMULATED_MS
from .test_page import text
from .test_round_trip import release
from .test_views import open_file, save
from .waiting import drawn

SVG = "{http://www.w3.org/2000/svg}"


def words(path: Path) -> list[str]:
    root = ElementTree.parse(path).getroot()
    assert root.tag == f"{SVG}svg"
    return [element.text or "" for element in root.iter(f"{SVG}text")]


def head_value(page: Page) -> float:
    """The number in the head of the Position lane, once the page has drawn one."""
    expect(page.locator("#value-position")).to_have_text(re.compile(r"^[-+\u2212]?[\d.]"))
    return float(text(page, "#value-position").split()[0])


def test_a_picture_says_of_what_it_is(page: Page, testbed: Testbed, tmp_path: Path) -> None:
    page.emulate_media(color_scheme="dark")
    testbed.client.set({"record.subject": "S07"})
    release(page, "30deg", "0.5")
    expect(page.locator("#release-residual")).to_contain_text("ticks RMS", timeout=SIMULATED_MS)
    page.check("#lane-xy")
    expect(page.locator("#xy-words")).to_contain_text("in N m over ticks")
    name = Path(testbed.client.experiment()["result"]["run"]).name
    path = save(page, "svg", tmp_path / "seen.svg")
    found = words(path)
    assert found[0] == name
    assert re.match(rf"{datetime.now(UTC).year}-\d\d-\d\d \d\d:\d\d:\d\d", found[1])
    assert "K = 0.012 N m/rad, B = 0 N m s/rad, N = 1, 1/T = 1000 Hz" in found[2]
    assert "region F1" in found[3]
    assert "subject S07" in found[3]
    for label in ("position", "as the spring sees", "simulated", "commanded", "ideal spring", "time (s)"):
        assert label in found
    drawn = path.read_text()
    assert "#ffffff" in drawn  # paper, on a dark screen too
    assert "var(" not in drawn
    assert drawn.count("<path") > 30
    png = save(page, "png", tmp_path / "seen.png").read_bytes()
    width, height = struct.unpack(">II", png[16:24])
    box = ElementTree.fromstring(drawn).get("viewBox", "").split()
    assert (width, height) == (2 * int(box[2]), 2 * int(box[3]))
    testbed.client.set({"record.subject": None})


def test_a_files_picture_has_its_own_name_date_and_settings(page: Page, run_file: Path, tmp_path: Path) -> None:
    open_file(page, run_file)
    found = words(save(page, "svg", tmp_path / "file.svg"))
    assert found[0] == run_file.name
    assert "N = 217" in found[2]
    assert "1/T = 2000 Hz" in found[2]


def test_a_file_without_a_date_gets_none(page: Page, tmp_path: Path) -> None:
    t = np.arange(400) * 1e-3
    table = {"time_s": t, "encoder_counts": np.arange(400), "current_command_A": np.sin(t)}
    pd.DataFrame(table).to_csv(tmp_path / "plain.csv", index=False)
    open_file(page, tmp_path / "plain.csv")
    assert words(save(page, "svg", tmp_path / "plain.svg"))[:2] == ["plain.csv", "no date"]


def test_nothing_covers_the_head_of_a_lane(page: Page) -> None:
    page.check("#lane-residual")
    wait_until(lambda: text(page, "#value-position") != "–", "a value")
    found = page.evaluate("""() => [...document.querySelectorAll(".lane-head")].map((head) => {
        const boxes = [...head.children].filter((each) => each.offsetWidth).map((each) => each.getBoundingClientRect());
        const before = (a, b) => a.right <= b.left + 0.5 || a.bottom <= b.top + 0.5;
        const apart = (a, b) => before(a, b) || before(b, a);
        const whole = head.scrollWidth <= head.clientWidth && head.scrollHeight <= head.clientHeight;
        return whole && boxes.every((a, i) => boxes.slice(i + 1).every((b) => apart(a, b)));
    })""")
    assert found
    assert all(found)


def test_places_in_the_unit_that_is_chosen(page: Page, run_file: Path, linear_file: Path, tmp_path: Path) -> None:
    open_file(page, run_file)
    ticks = head_value(page)
    assert ticks != 0
    for unit, factor in (("deg", 217 * 360 / 8192), ("rad", 217 * 2 * 3.14159265 / 8192), ("ticks", 1.0)):
        page.select_option("#place-unit", unit)
        expect(page.locator(".lane-head .unit").first).to_contain_text(unit)
        drawn(page)
        assert head_value(page) == pytest.approx(ticks * factor, rel=2e-3)
    page.select_option("#place-unit", "deg")
    assert "Position (deg)" in words(save(page, "svg", tmp_path / "deg.svg"))
    open_file(page, linear_file)
    assert page.locator("#place-unit option").all_inner_texts() == ["ticks", "m", "mm"]
    page.select_option("#place-unit", "mm")
    drawn(page)
    run = read_run(linear_file)
    assert head_value(page) == pytest.approx(run.columns["encoder_counts"][-1] / 100, rel=2e-3)  # 1e5 counts in a metre
    assert "Position (mm)" in words(save(page, "svg", tmp_path / "mm.svg"))


def y_range(page: Page) -> tuple[float, float]:
    least, largest = (page.locator(f"#y-{which}-position").input_value() for which in ("least", "largest"))
    return float(least), float(largest)


def test_the_y_range_is_typed_zoomed_dragged_and_taken_back(page: Page, run_file: Path, tmp_path: Path) -> None:
    open_file(page, run_file)
    auto = page.locator('section[aria-label="Position"] .y-auto')
    expect(auto).to_have_attribute("aria-pressed", "true")
    page.fill("#y-least-position", "-2,5")
    page.fill("#y-largest-position", "5")
    page.press("#y-largest-position", "Enter")
    expect(page.locator("#y-largest-position")).to_have_attribute("aria-invalid", "true")
    expect(auto).to_have_attribute("aria-pressed", "true")
    page.fill("#y-least-position", "-2.5")
    page.fill("#y-largest-position", "5")
    page.press("#y-largest-position", "Enter")
    expect(auto).to_have_attribute("aria-pressed", "false")
    page.locator("#y-largest-position").blur()
    assert y_range(page) == (-2.5, 5.0)
    found = words(save(page, "svg", tmp_path / "range.svg"))
    assert "4" in found
    assert "6" not in found
    axis = page.locator('section[aria-label="Position"] .y-axis').bounding_box()
    assert axis is not None
    middle = axis["y"] + axis["height"] / 2
    page.mouse.move(axis["x"] + 20, middle)
    page.mouse.wheel(0, -100)
    drawn(page)
    low, high = y_range(page)
    assert high - low == pytest.approx(7.5 / 1.25, rel=1e-2)
    page.mouse.down()
    page.mouse.move(axis["x"] + 20, middle + axis["height"] / 4, steps=4)
    page.mouse.up()
    drawn(page)
    assert sum(y_range(page)) > low + high + 1.0
    # in another unit it is the same range
    low, high = y_range(page)
    page.select_option("#place-unit", "deg")
    drawn(page)
    assert y_range(page)[1] == pytest.approx(high * 217 * 360 / 8192, rel=1e-2)
    auto.click()
    expect(auto).to_have_attribute("aria-pressed", "true")
    expect(page.locator("#y-least-position")).to_have_value("")
