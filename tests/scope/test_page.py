"""The page in a real browser, on a real daemon on the loopback: what an operator does, and what the page then says."""

from __future__ import annotations

import base64
import signal
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from playwright.sync_api import Page, WebSocketRoute, expect

from hapticd.record import read_run
from tests.polling import wait_until

from .browser import Testbed
from .conftest import SIMULATED_MS, Open
from .waiting import captures, drawn


def text(page: Page, selector: str) -> str:
    return page.locator(selector).inner_text()


def enter(page: Page, key: str, value: object) -> None:
    field = page.locator(f"#set-{key}-entry")
    field.fill(str(value))
    field.press("Enter")


def seen_rows(page: Page) -> int:
    return int(page.locator("body").get_attribute("data-seen") or 0)


def age_s(page: Page) -> float:
    found = text(page, "#age").removesuffix(" old")
    if found.startswith("<"):
        return 0.1
    number, unit = found.split()
    return float(number) * {"ms": 1e-3, "s": 1.0, "min": 60.0}[unit]


def test_start_and_the_trace_runs(page: Page, testbed: Testbed) -> None:
    page.click("#start")
    expect(page.locator("#state")).to_have_text("running", ignore_case=True)
    assert testbed.state() == "running"
    wait_until(lambda: seen_rows(page) > 1900, "two seconds of rows in view")
    expect(page.locator("#value-position")).to_contain_text(" rad")
    wait_until(lambda: age_s(page) < 1, "a young trace")
    assert text(page, "#gaps").endswith("0 rows lost on the way")
    page.keyboard.press("Escape")
    expect(page.locator("#stop-answer")).to_have_text("Stop: the daemon says off")
    assert testbed.state() == "off"


def test_stiffness_dragged_over_a_boundary(page: Page, testbed: Testbed) -> None:
    expect(page.locator("#region")).to_have_text("F1")
    slider = page.locator("#set-spring-stiffness")
    box = slider.bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + box["width"] * 0.41, middle)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 0.75, middle, steps=10)
    expect(page.locator("#ghost-words")).to_contain_text("would land in D|E, that is ")
    expect(page.locator("#ghost")).to_be_attached()
    assert testbed.client.config()["spring"]["stiffness"] == 0.012  # nothing is sent while it is held
    assert slider.bounding_box() == box  # and it stays under the hand
    page.mouse.up()
    expect(page.locator("#region")).to_have_text("D|E")
    sent = testbed.client.config()["spring"]["stiffness"]
    assert 0.3 < sent < 1
    expect(page.locator("#set-spring-stiffness-confirmed")).to_have_text(f"{sent:g}")
    expect(page.locator("#ghost-words")).to_have_text("")
    point = testbed.client.status()["operating_point"]
    assert point["region"] == "D|E"
    assert float(text(page, "#beta")) == pytest.approx(point["beta"], rel=1e-3)
    assert float(text(page, "#sigma")) == pytest.approx(point["sigma"], rel=1e-3)
    assert page.locator(".trail-dot").count() >= 1


def test_what_starts_end_in_follows_the_settings(page: Page, testbed: Testbed) -> None:
    expect(page.locator("#ends")).to_have_text("rest 100 %, proven")
    testbed.client.set({"safety.guard": "warn", "encoder.decimation": 2172})
    expect(page.locator("#ends")).to_contain_text("wandering")
    expect(page.locator("#ends")).to_contain_text("largest ±0.0")


def test_a_refusal_stands_at_its_control_in_the_daemons_words(page: Page, testbed: Testbed) -> None:
    enter(page, "servo-rate_hz", 123456)
    expect(page.locator("#set-servo-rate_hz-refusal")).to_contain_text("servo.rate_hz")
    expect(page.locator("#set-servo-rate_hz-refusal")).to_contain_text("20000")
    expect(page.locator("#set-servo-rate_hz-confirmed")).to_have_text("1000")
    assert text(page, "#set-spring-stiffness-refusal") == ""
    enter(page, "servo-rate_hz", 500)
    expect(page.locator("#set-servo-rate_hz-refusal")).to_have_text("")
    expect(page.locator("#rate")).to_have_text("500 Hz")
    assert testbed.client.config()["servo"]["rate_hz"] == 500


def test_release_with_the_exact_simulation_over_it(page: Page, testbed: Testbed) -> None:
    """The daemon's loopback is that very plant: where no period was missed the residual is a fraction of a tick."""
    testbed.client.set({"encoder.decimation": 217})
    expect(page.locator("#set-encoder-decimation-confirmed")).to_have_text("217")
    page.click("#to-release")
    page.fill("#release-deflection", "20.3")
    page.fill("#release-duration", "2")
    page.click("#release-form button")
    expect(page.locator("#release-outcome")).to_contain_text("decaying: it came or comes to rest")
    expect(page.locator("#release-residual")).to_contain_text("ticks RMS over", timeout=SIMULATED_MS)
    assert text(page, "#release-answer") == "released from 20.3 ticks, exact to one raw count"
    residual = float(text(page, "#release-residual").split()[1])
    assert residual < 3.0
    expect(page.locator("#hold-why")).to_contain_text("the release, taken as a single shot")
    expect(page.locator("#lane-residual")).to_be_checked()
    assert testbed.client.experiment()["result"]["outcome"] == "decaying"
    assert testbed.state() == "off"


def test_a_fault_freezes_the_trace_and_is_cleared(page: Page, testbed: Testbed) -> None:
    testbed.client.set({"safety.max_velocity": 20, "encoder.decimation": 217})
    expect(page.locator("#set-encoder-decimation-confirmed")).to_have_text("217")
    page.click("#to-release")
    page.fill("#release-deflection", "20.3")
    page.click("#release-form button")
    expect(page.locator("#state")).to_have_text("fault", ignore_case=True)
    expect(page.locator("#banner-title")).to_have_text("Fault: over_speed")
    expect(page.locator("#banner-cause")).to_contain_text("is above safety.max_velocity = 20 rad/s")
    expect(page.locator("#banner-clear")).to_contain_text("Hold the handle")
    expect(page.locator("#hold-why")).not_to_have_text("")
    page.click("#fault-page")
    expect(page.locator("#page-text")).to_contain_text("What hapticd did")
    page.click("#page button.close")
    # frozen: what is seen does not move, and holds the rows before and after the fault
    drawn(page)
    rows = seen_rows(page)
    assert rows > 50  # the single shot begins at the release; how many follow the fault depends on where its frame ends
    drawn(page)
    assert seen_rows(page) == rows
    page.click("#clear")
    expect(page.locator("#banner")).to_be_hidden()
    assert testbed.state() == "off"
    page.click("#run")
    expect(page.locator("#hold-why")).to_have_text("")


def test_a_click_means_what_the_button_said_when_it_was_pressed(page: Page, testbed: Testbed) -> None:
    """Somebody else begins a recording while Record is held down: to let it go does not end theirs."""
    record = page.locator("#record")
    expect(record).to_have_text("Record")
    record.hover()
    page.mouse.down()
    path = testbed.client.record_start()["path"]
    expect(page.locator("#h-recorder")).to_contain_text(Path(path).name)  # the page knows
    expect(record).to_have_text("Record")
    page.mouse.up()
    expect(page.locator("#command-answer")).to_contain_text("already")
    assert testbed.client.status()["recorder"]["path"] == path
    expect(record).to_have_text("Stop recording")
    record.click()
    expect(record).to_have_text("Record")


def test_a_slow_double_click_is_one_click(page: Page, testbed: Testbed) -> None:
    record = page.locator("#record")
    record.click()
    expect(record).to_have_text("Stop recording")
    page.mouse.down(click_count=2)
    page.mouse.up(click_count=2)
    captures(page, 500)
    expect(record).to_have_text("Stop recording")
    record.click()
    expect(record).to_have_text("Record")
    assert testbed.client.status()["recorder"]["path"] is None


def test_estop_with_the_stream_cut(open_page: Open, testbed: Testbed) -> None:
    def cut(page: Page) -> None:
        page.route_web_socket("**/ws/*", lambda socket: socket.close())

    page = open_page(ready=False, before=cut)
    expect(page.locator("#offline")).to_be_visible()
    testbed.client.start()
    page.click("#estop", force=True)
    expect(page.locator("#stop-answer")).to_have_text("E-stop: the daemon says fault")
    assert testbed.client.status()["fault"]["code"] == "estop"


def test_stop_with_the_page_half_loaded(open_page: Open, testbed: Testbed) -> None:
    """Neither the main script nor uPlot nor the style sheet came; Esc stops, twice Esc is the e-stop."""

    def half(page: Page) -> None:
        for part in ("**/js/*.js", "**/vendor/**", "**/*.css"):
            page.route(part, lambda route: route.abort())

    page = open_page(ready=False, before=half)
    testbed.client.start()
    page.keyboard.press("Escape")
    expect(page.locator("#stop-answer")).to_have_text("Stop: the daemon says off")
    assert testbed.state() == "off"
    page.wait_for_timeout(1100)
    testbed.client.start()
    # within a second of the page's, however long a key press takes to get there
    page.evaluate("for (const key of ['Escape', 'Escape']) window.dispatchEvent(new KeyboardEvent('keydown', { key }))")
    expect(page.locator("#stop-answer")).to_have_text("E-stop: the daemon says fault")
    assert testbed.state() == "fault"


def test_a_stop_that_cannot_be_sent_says_so(open_page: Open) -> None:
    page = open_page()
    page.route("**/api/*", lambda route: route.abort())
    page.click("#stop")
    expect(page.locator("#stop-answer")).to_contain_text("NOT SENT")
    expect(page.locator("#stop-answer")).to_contain_text("Cut the power of the amplifier")


def test_the_controls_are_taken_over(page: Page, open_page: Open, testbed: Testbed) -> None:
    other = open_page()
    expect(other.locator("#lease")).to_have_text("another page has the controls")
    expect(other.locator("#start")).to_be_disabled()
    expect(other.locator("#stop")).to_be_enabled()
    expect(page.locator("#start")).to_be_enabled()
    other.click("#take")
    expect(other.locator("#lease")).to_have_text("this page has the controls")
    expect(page.locator("#lease")).to_have_text("another page has the controls")
    expect(page.locator("#start")).to_be_disabled()
    other.click("#start")
    expect(page.locator("#state")).to_have_text("running", ignore_case=True)
    page.click("#stop")
    wait_until(lambda: testbed.state() == "off", "a stop by the page that only watches")


def test_a_reload_keeps_the_controls(page: Page) -> None:
    page.reload()
    expect(page.locator("#lease")).to_have_text("this page has the controls")


def test_view_only(open_page: Open, testbed: Testbed) -> None:
    page = open_page(testbed.view_url)
    expect(page.locator("#lease")).to_have_text("view only")
    for button in ("#start", "#stop", "#estop"):
        expect(page.locator(button)).to_be_disabled()
    wait_until(lambda: seen_rows(page) > 100, "rows")
    testbed.client.start()
    page.keyboard.press("Escape")
    expect(page.locator("#stop-answer")).to_contain_text("REFUSED: this token may only look")
    assert testbed.state() == "running"


def test_a_wrong_token_is_told(open_page: Open, testbed: Testbed) -> None:
    page = open_page(testbed.url.split("#")[0] + "#wrong", ready=False)
    expect(page.locator("#offline-why")).to_contain_text("use the URL just printed")


def test_a_server_that_stands_still_ages_the_trace(page: Page, testbed: Testbed) -> None:
    """As a suspended laptop or a stalled network looks: the age goes on by the wall clock, and afterwards is right."""
    wait_until(lambda: seen_rows(page) > 500, "rows")
    assert testbed.scope is not None
    testbed.scope.send_signal(signal.SIGSTOP)
    try:
        wait_until(lambda: age_s(page) > 2, "an old trace")
        assert "bad" in (page.locator("#age").get_attribute("class") or "")
    finally:
        testbed.scope.send_signal(signal.SIGCONT)
    wait_until(lambda: age_s(page) < 0.5, "a young trace")


def test_a_suspended_tab(page: Page) -> None:
    wait_until(lambda: seen_rows(page) > 500, "rows")
    session = page.context.new_cdp_session(page)
    session.send("Page.setWebLifecycleState", {"state": "frozen"})
    time.sleep(3)
    session.send("Page.setWebLifecycleState", {"state": "active"})
    wait_until(lambda: age_s(page) < 0.5, "a young trace")
    drawn = int(page.locator("body").get_attribute("data-frames") or 0)
    wait_until(lambda: int(page.locator("body").get_attribute("data-frames") or 0) > drawn + 5, "a trace that is drawn")


def test_reconnects_after_the_daemon_restarts(open_page: Open, testbed: Testbed) -> None:
    page = open_page()
    wait_until(lambda: seen_rows(page) > 500, "rows")
    testbed.stop_daemon()
    expect(page.locator("#banner-title")).to_have_text("No daemon")
    expect(page.locator("#banner-cause")).to_contain_text("no daemon answers on")
    expect(page.locator("#state")).to_have_text("unreachable", ignore_case=True)
    wait_until(lambda: age_s(page) > 1, "an old trace")
    testbed.start_daemon()
    expect(page.locator("#state")).to_have_text("off", ignore_case=True)
    expect(page.locator("#banner")).to_be_hidden()
    wait_until(lambda: age_s(page) < 0.5, "a young trace")


def test_a_dropped_run_opens_in_the_same_scope(page: Page, run_file: Path) -> None:
    content = base64.b64encode(run_file.read_bytes()).decode()
    page.evaluate(
        """([content, name]) => {
            const bytes = Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0));
            const data = new DataTransfer();
            data.items.add(new File([bytes], name));
            document.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true }));
        }""",
        [content, run_file.name],
    )
    expect(page.locator("#file-name")).to_have_text("sim.arrow: 1000 rows")
    wait_until(lambda: seen_rows(page) == 1000, "the whole run in view")
    page.click("#to-measure")
    run = read_run(run_file)
    position = run.columns["encoder_counts"] / 217
    expect(page.locator("#m-pp")).to_contain_text(f"{np.ptp(position):.4g} ticks")
    expect(page.locator("#spectrum-peak")).to_contain_text("Hz")
    page.click("#back")
    expect(page.locator("#file-name")).to_be_hidden()
    wait_until(lambda: seen_rows(page) not in (0, 1000), "live rows")


def test_a_file_that_is_no_run_is_refused_in_words(page: Page, tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.arrow"
    wrong.write_text("no run")
    page.click("#to-files")
    page.set_input_files("#open-file", wrong)
    expect(page.locator("#file-answer")).to_contain_text("not a run file")


def test_what_is_seen_is_saved(page: Page, tmp_path: Path) -> None:
    wait_until(lambda: seen_rows(page) > 1900, "rows")
    page.keyboard.press(" ")
    drawn(page)
    page.click("#to-files")
    saved = {}
    for kind in ("csv", "arrow", "png"):
        with page.expect_download() as found:
            page.click(f"#save-{kind}")
        saved[kind] = tmp_path / f"saved.{kind}"
        found.value.save_as(saved[kind])
    run, table = read_run(saved["arrow"]), pd.read_csv(saved["csv"])
    assert run.metadata["kind"] == "scope"
    assert run.rows == len(table) > 1900
    assert not table.isna().any(axis=None)
    for name in ("tick", "time_s", "encoder_counts", "current_command_A", "force_command"):
        np.testing.assert_array_equal(run.columns[name], table[name])
    assert saved["png"].read_bytes().startswith(b"\x89PNG")
    assert saved["png"].stat().st_size > 5000


@pytest.mark.parametrize("what", ["settings", "release", "rising"])
def test_a_single_shot_is_taken_and_held(page: Page, testbed: Testbed, what: str) -> None:
    """By a changed setting, by the start of rendering, and by the level of a channel whose lane is not shown."""
    page.select_option("#trigger-on", what, force=True)
    page.select_option("#window", "0.2")
    page.select_option("#trigger-mode", "single")
    if what == "rising":
        page.select_option("#trigger-channel", "late")
        page.fill("#trigger-level", str(testbed.client.status()["timing"]["wake_us"]["p50"]))
        page.keyboard.press("Enter")
        page.fill("#trigger-hysteresis", "0")
        page.keyboard.press("Enter")
    elif what == "settings":
        testbed.client.set({"spring.stiffness": 0.013})
    else:
        testbed.client.start()
    if what != "rising":
        expect(page.locator("#hold-why")).to_have_text("single shot taken")
    else:
        wait_until(lambda: text(page, "#hold-why") == "single shot taken", "a late tick")
    rows = seen_rows(page)
    assert rows > 50
    drawn(page)
    assert seen_rows(page) == rows


def test_cursors_measure(page: Page) -> None:
    wait_until(lambda: seen_rows(page) > 1900, "rows")
    page.keyboard.press(" ")
    page.click("#to-measure")
    lane = page.locator(".lane .u-over").first
    box = lane.bounding_box()
    assert box is not None
    lane.click(position={"x": box["width"] * 0.25, "y": 20})
    lane.click(position={"x": box["width"] * 0.75, "y": 20}, modifiers=["Shift"])
    expect(page.locator("#m-dt")).to_have_text("1 s")
    expect(page.locator("#m-hz")).to_have_text("1 Hz")
    expect(page.locator("#m-rows")).to_contain_text("between A and B")
    lane.click(position={"x": 50, "y": 10}, modifiers=["Alt"])
    lane.click(position={"x": 50, "y": 40}, modifiers=["Alt", "Shift"])
    expect(page.locator("#m-y")).to_contain_text("ticks =")
    page.locator("body").press("c")
    expect(page.locator("#m-dt")).to_have_text("set cursors A and B")


def test_the_keyboard_does_it(page: Page) -> None:
    body = page.locator("body")
    wait_until(lambda: seen_rows(page) > 1900, "rows")
    body.press("3")
    expect(page.locator("#lane-velocity")).to_be_checked()
    body.press(" ")
    expect(page.locator("#run")).to_have_text("Run")
    body.press("+")
    wait_until(lambda: seen_rows(page) < 1700, "a shorter window")
    body.press("ArrowLeft")
    body.press(" ")
    expect(page.locator("#run")).to_have_text("Hold")
    body.press("?")
    expect(page.locator("#keys")).to_be_visible()
    page.click("#keys button")
    page.locator("#to-settings").focus()
    page.keyboard.press("ArrowRight")
    expect(page.locator("#tab-release")).to_be_visible()


def test_health_and_energy_are_told(page: Page) -> None:
    page.click("#to-health")
    expect(page.locator("#h-late")).to_contain_text("p99.9")
    assert page.locator("#late-histogram rect").count() == 14
    assert page.locator("#h-energy .energy-row").count() == 4
    assert page.locator("#h-grants li").count() >= 3
    expect(page.locator("#h-page")).to_contain_text("at most 1048576 rows")


@pytest.mark.parametrize("size", [(1280, 720), (1024, 768), (820, 1180)])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits(open_page: Open, size: tuple[int, int], scheme: str) -> None:
    page = open_page(before=lambda page: page.emulate_media(color_scheme=scheme))  # type: ignore[arg-type]
    page.set_viewport_size({"width": size[0], "height": size[1]})
    wait_until(lambda: seen_rows(page) > 100, "rows")
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    for selector in ("#stop", "#estop", "#lanes", "#plane"):
        box = page.locator(selector).bounding_box()
        assert box is not None
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= size[0]
    background = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (sum(int(part) for part in background[4:-1].split(",")) < 200) == (scheme == "dark")


def test_texts_of_the_daemon_are_text(open_page: Open) -> None:
    """A device's own words must not become markup."""
    evil = '<img src=x onerror="document.title=1">'

    def forge(route: WebSocketRoute) -> None:
        server = route.connect_to_server()

        def pass_on(message: str | bytes) -> None:
            if isinstance(message, str) and '"type":"state"' in message:
                quoted = evil.replace('"', '\\"')
                fault = f'"fault":{{"code":"estop","cause":"{quoted}","help":"{quoted}"}}'
                message = message.replace('"fault":null', fault)
            route.send(message)

        server.on_message(pass_on)

    page = open_page(before=lambda page: page.route_web_socket("**/ws/state", forge))
    expect(page.locator("#banner-cause")).to_have_text(evil)
    assert page.locator("#banner img").count() == 0
    assert page.title() == "hapticd scope"


def test_virtual_damping_has_a_slider_that_reaches_zero(page: Page, testbed: Testbed) -> None:
    slider = page.locator("#set-spring-damping")
    expect(slider).to_have_value("0")
    slider.focus()
    for _ in range(300):
        page.keyboard.press("ArrowRight")
    expect(page.locator("#set-spring-damping-confirmed")).not_to_have_text("0")
    assert testbed.client.config()["spring"]["damping"] > 0
    slider.focus()
    page.keyboard.press("Home")
    expect(page.locator("#set-spring-damping-confirmed")).to_have_text("0")
    assert testbed.client.config()["spring"]["damping"] == 0
