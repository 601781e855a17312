"""Derived channels: a small expression over the known ones, drawn, measured and triggered on as they are."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from tests.polling import wait_until

from .browser import Testbed
from .conftest import Open

EVALUATE = """async ([texts, values]) => {
    const { compile } = await import("/static/js/expression.js");
    const variable = (name) => { if (!(name in values)) throw new Error(`no ${name}`); return () => values[name]; };
    return texts.map((text) => {
        try { return compile(text, variable)(); }
        catch (error) { return error.message; }
    });
}"""
VALUES = {"x": 2.0, "force": -3.0, "spring.stiffness": 0.5}
EXPRESSIONS: list[tuple[str, Any]] = [
    ("1 + 2 * 3", 7),
    ("(1 + 2) * 3", 9),
    ("8 - 4 - 2", 2),
    ("8 / 4 / 2", 1),
    ("2 ^ 3 ^ 2", 512),
    ("-2 ^ 2", -4),
    ("2 ^ -1", 0.5),
    ("2 * -x", -4),
    ("--x", 2),
    ("1.5e-3*x", 0.003),
    (".5", 0.5),
    ("force * x", -6),
    ("force + spring.stiffness * x", -2),
    ("abs(force) + sqrt(16) - max(1, x, 3) + min(x, 5)", 6),
    ("sin(pi / 2) + cos(0) + exp(0) + log(1) + sign(force)", 2),
    ("1 / 0", math.inf),
    ("", "a value is missing before the end"),
    ("1 +", "a value is missing before the end"),
    ("1 2", "2 is left over"),
    ("(1", ") is missing before the end"),
    ("2,5", ", is left over"),
    ("x y", "y is left over"),
    ("vel", "no vel"),
    ("eval(1)", "eval is no function; there are abs, sqrt, exp, log, sin, cos, sign, min, max"),
    ("constructor(1)", "constructor is no function; there are abs, sqrt, exp, log, sin, cos, sign, min, max"),
    ("x[0]", "[ at character 2 means nothing here"),
    ("x = 1", "= at character 3 means nothing here"),
    ("'a'", "' at character 1 means nothing here"),
    ("(" * 70 + "1" + ")" * 70, "more than 64 in each other"),
]


def test_expressions(page: Page) -> None:
    found = page.evaluate(EVALUATE, [[text for text, _ in EXPRESSIONS], VALUES])
    right = [value if isinstance(value, str) else pytest.approx(value) for _, value in EXPRESSIONS]
    assert dict(zip([text for text, _ in EXPRESSIONS], found, strict=True)) == dict(
        zip([text for text, _ in EXPRESSIONS], right, strict=True)
    )


def define(page: Page, name: str, text: str) -> None:
    page.click("#to-measure")
    page.fill(f"#{name}", text)
    page.press(f"#{name}", "Enter")


def shown(page: Page, name: str) -> float:
    return float(page.locator(f"#value-{name}").inner_text().replace("−", "-").replace("–", "nan"))


def test_a_derived_channel_of_live_rows(page: Page, testbed: Testbed) -> None:
    define(page, "derived1", "late * 1e6 + 1000")
    expect(page.locator("#derived1-refusal")).to_have_text("")
    expect(page.locator(".lane[aria-label='derived 1']")).to_be_visible()
    expect(page.locator("#lane-derived1")).to_be_checked()
    wait_until(lambda: shown(page, "derived1") >= 1000, "shown", 30)
    page.select_option("#measure-channel", "derived1")
    expect(page.locator("#m-rows")).to_contain_text("rows of derived 1")
    page.select_option("#trigger-mode", "normal")
    page.select_option("#trigger-channel", "derived1")
    page.fill("#trigger-level", "999")
    page.press("#trigger-level", "Enter")
    expect(page.locator("#trigger-refusal")).to_have_text("")
    # what is wrong is said there, and what was drawn stays
    define(page, "derived1", "lat * 2")
    expect(page.locator("#derived1-refusal")).to_contain_text(
        "lat is no channel and no setting; channels are position,"
    )
    expect(page.locator(".lane[aria-label='derived 1']")).to_be_visible()
    define(page, "derived1", "")
    expect(page.locator(".lane[aria-label='derived 1']")).to_have_count(0)
    expect(page.locator("#trigger-channel option[value=derived1]")).to_have_count(0)


def test_it_is_worked_out_in_si_for_a_file_too(page: Page, open_page: Open, run_file: Path) -> None:
    define(page, "derived1", "force + spring.stiffness * coarse")
    define(page, "derived2", "position - coarse")
    page.set_input_files("#open-file", run_file)
    expect(page.locator("#file-name")).to_contain_text("sim.arrow")
    tick = 217 * 2 * math.pi / 8192
    found = page.evaluate(
        """async (names) => {
            const { LOOK } = await import("/static/js/lane.js");
            return names.map((name) => [LOOK[name].label, document.querySelector(`#value-${name}`).textContent]);
        }""",
        ["derived1", "derived2"],
    )
    assert [label for label, _ in found] == ["derived 1", "derived 2"]
    # the spring sees the middle of its tick: F = −K (⌊ξ⌋ + ½) Δ, and the place is within the tick
    wait_until(lambda: shown(page, "derived1") == pytest.approx(-0.012 * tick / 2, rel=2e-3), "derived 1", 30)
    wait_until(lambda: 0.0 <= shown(page, "derived2") < tick, "derived 2", 30)
