"""The page's own arithmetic, in the browser that runs it, against numpy."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

from hapticd.record.frames import Context, decode, encode
from hapticd.record.schema import FLAG_FAULT, FLAG_MISSED_PERIOD, FLAG_RUNNING, Rows, empty_rows

from .conftest import Open
from .served import serve
from .waiting import captures, drawn

CAPACITY = 1 << 16


@pytest.fixture(scope="module")
def blank(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """The page without a daemon, to load its modules in."""
    with serve(tmp_path_factory.mktemp("blank") / "nobody.sock") as served:
        page = browser.new_page()
        page.goto(served.origin)
        yield page
        page.close()


def rows(count: int, first_tick: int = 0, period_s: float = 1e-3) -> Rows:
    made = empty_rows(count)
    made["tick"] = first_tick + np.arange(count)
    made["time_s"] = made["tick"] * period_s
    return made


def frame(made: Rows, first_row: int, epoch: int = 0) -> list[int]:
    return list(encode(made, Context(first_row, epoch, 1, 1e-3, 0, 0.0)))


def store(page: Page, frames: list[list[int]], then: str, argument: Any = None) -> Any:
    """What ``then``, a function of a filled store and an argument, gives."""
    return page.evaluate(
        f"""async ([frames, capacity, argument]) => {{
            const {{ Store }} = await import("/static/js/store.js");
            const {{ decode }} = await import("/static/js/frames.js");
            const {{ Trigger }} = await import("/static/js/trigger.js");
            const store = new Store(capacity);
            const append = (bytes) => store.append(decode(new Uint8Array(bytes).buffer));
            for (const bytes of frames) append(bytes);
            return ({then})(store, argument, Trigger, append);
        }}""",
        [frames, CAPACITY, argument],
    )


def test_extents_are_those_of_all_rows(blank: Page) -> None:
    rng = np.random.default_rng(3)
    made = rows(6000)
    made["force_command"] = rng.normal(size=6000).astype(np.float32)
    ranges = [sorted(map(int, rng.integers(0, 6000, 2))) for _ in range(200)]
    parts = [frame(made[start : start + 333], start) for start in range(0, 6000, 333)]
    extents = "(store, all) => all.map(([a, b]) => { const o = []; store.extent('force', a, b, o); return o; })"
    found = store(blank, parts, extents, ranges)
    force = made["force_command"]
    for (begin, end), (low, high) in zip(ranges, found, strict=True):
        if end > begin:
            assert (low, high) == (force[begin:end].min(), force[begin:end].max())


def test_the_ring_forgets_the_oldest_and_its_extents_stay_right(blank: Page) -> None:
    count = CAPACITY + 20_000
    found = blank.evaluate(
        """async ([capacity, count]) => {
            const { Store } = await import("/static/js/store.js");
            const store = new Store(capacity);
            const rows = 1000;
            for (let from = 0; from < count; from += rows) {
                const zeros = () => new Float32Array(rows);
                store.append({ rows, firstRow: from, firstTick: from, epoch: 0, decimation: 1,
                    timeS: from / 1000, periodS: 1e-3, unixS: 0,
                    originCounts: 0, tickOffset: Int32Array.from({ length: rows }, (_, i) => i),
                    timeOffset: Float32Array.from({ length: rows }, (_, i) => i / 1000), counts: new Int32Array(rows),
                    ticks: new Int32Array(rows), current: zeros(), measured: zeros(),
                    force: Float32Array.from({ length: rows }, (_, i) => from + i), late: zeros(),
                    flags: new Int32Array(rows) });
            }
            const out = [];
            store.extent("force", store.first, store.head, out);
            return [store.first, store.head, ...out, store.bytes];
        }""",
        [CAPACITY, count],
    )
    head = -(-count // 1000) * 1000
    assert found[:4] == [head - CAPACITY, head, head - CAPACITY, head - 1]
    assert found[4] / CAPACITY < 70  # bytes a row


def test_gaps_are_told_apart_and_counted(blank: Page) -> None:
    late = rows(100, 100)
    late["tick"][50:] += 7
    late["flags"][50] = FLAG_MISSED_PERIOD
    parts = [frame(rows(100), 0), frame(late, 100), frame(rows(50, 257), 250)]
    gaps = store(blank, parts, "(store) => [store.gaps, store.missed, store.lost]")
    assert [(gap["row"], gap["ticks"], gap["kind"]) for gap in gaps[0]] == [(150, 7, "missed"), (200, 50, "lost")]
    assert gaps[1:] == [7, 50]


def test_buckets_cover_all_rows_once_and_never_reach_across_a_wide_gap(blank: Page) -> None:
    parts = [frame(rows(1000), 0), frame(rows(1000, 1500), 1500), frame(rows(1000, 2600), 2600)]
    found = store(blank, parts, "(store) => store.buckets(0, store.head, 100, 0.4)")
    pieces = list(zip(found["starts"], found["ends"], strict=True))
    assert pieces.count((-1, -1)) == 1
    real = [piece for piece in pieces if piece != (-1, -1)]
    assert real[0][0] == 0
    assert real[-1][1] == 3000
    assert all(before[1] == after[0] for before, after in itertools.pairwise(real))
    assert any(end == 1000 for _, end in real)
    assert len(real) < 220


def test_another_servo_loop_goes_on_to_the_right(blank: Page) -> None:
    times = store(
        blank,
        [frame(rows(100, 5000), 5000), frame(rows(100), 0)],
        "(store) => [store.timeAt(99), store.timeAt(100), store.gaps, store.lost]",
    )
    assert times[1] == pytest.approx(times[0] + 1)
    assert times[2][0]["kind"] == "restart"
    assert times[3] == 0


def test_a_picture_put_aside_is_what_it_was(blank: Page) -> None:
    """Over the place where the ring begins anew, with its gap, and with the extents that the trace draws."""
    count, begin, end, gap = CAPACITY + 3000, CAPACITY - 2000, CAPACITY + 2500, CAPACITY + 100
    found = blank.evaluate(
        """async ([capacity, count, begin, end, gap]) => {
            const { Store } = await import("/static/js/store.js");
            const store = new Store(capacity);
            const rows = 1000;
            const force = (row) => Math.fround(((row * 7919) % 10007) / 10);
            for (let from = 0; from < count; from += rows) {
                const zeros = () => new Float32Array(rows);
                store.append({ rows, firstRow: from, firstTick: from, epoch: 0, decimation: 1, timeS: from / 1000,
                    periodS: 1e-3, unixS: 0, originCounts: 0,
                    tickOffset: Int32Array.from({ length: rows }, (_, i) => i + (from + i >= gap ? 5 : 0)),
                    timeOffset: Float32Array.from({ length: rows }, (_, i) => i / 1000), counts: new Int32Array(rows),
                    ticks: new Int32Array(rows), current: zeros(), measured: zeros(), late: zeros(),
                    force: Float32Array.from({ length: rows }, (_, i) => force(from + i)), flags: new Int32Array(rows) });
            }
            const copy = store.copy(begin, end);
            const extents = [[0, end - begin], [17, 1300], [2000, 2050]].map(([from, to]) => {
                const [whole, part] = [[], []];
                store.extent("force", begin + from, begin + to, whole);
                copy.extent("force", from, to, part);
                return [whole, part];
            });
            const last = copy.timeAt(copy.head - 1);
            return [copy.first, copy.head, copy.gaps, extents, copy.tick[0], last, copy.value("force", 7),
                force(begin + 7)];
        }""",
        [CAPACITY, count, begin, end, gap],
    )
    first, head, gaps, extents, tick, time_s, value, expected = found
    assert (first, head, tick, value) == (0, end - begin, begin, expected)
    assert gaps == [{"row": gap - begin, "ticks": 5, "kind": "missed"}]
    assert all(whole == part for whole, part in extents)
    assert time_s == pytest.approx((end - 1) / 1000)


def test_a_moved_origin_is_no_velocity(blank: Page) -> None:
    made = rows(100, 100)
    parts = [frame(rows(100), 0), list(encode(made, Context(100, 0, 1, 1e-3, -500, 0.0)))]
    found = store(blank, parts, "(store) => Array.from(store.channels.velocity.values.slice(90, 120), (v) => v || 0)")
    assert found == [0.0] * 30


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"on": "rising", "level": 0.0, "hysteresis": 0.5}, [100, 500]),
        ({"on": "falling", "level": 0.0, "hysteresis": 0.5}, [300]),
        ({"on": "rising", "level": 0.0, "hysteresis": 0.5, "holdoffS": 0.45}, [100]),
        ({"on": "rising", "level": 2.0, "hysteresis": 0.0}, []),
        ({"on": "rising", "level": 0.0, "hysteresis": 1.5}, []),
        ({"on": "fault"}, [250]),
        ({"on": "release"}, [150]),
        ({"on": "settings"}, [256]),
    ],
)
def test_the_trigger_fires_where_it_should(blank: Page, settings: dict[str, Any], expected: list[int]) -> None:
    made = rows(512)
    made["force_command"] = -np.cos(np.arange(512) * np.pi / 200 + np.pi / 1e6)
    made["force_command"][99] = -0.001
    made["flags"][150:250] = FLAG_RUNNING
    made["flags"][250:] = FLAG_FAULT
    parts = [frame(made[:256], 0, epoch=1), frame(made[256:], 256, epoch=2)]
    found = store(
        blank,
        parts,
        """(store, given, Trigger) => {
            const trigger = new Trigger();
            Object.assign(trigger.settings, { mode: "normal", channel: "force", holdoffS: 0, pre: 1 }, given);
            const fired = [];
            const all = store.head;
            for (store.head = 1; store.head <= all; store.head++) {
                const before = trigger.at;
                trigger.look(store, 0.01);
                if (trigger.at !== before) fired.push(trigger.at);
            }
            return fired;
        }""",
        settings,
    )
    assert found == expected


def test_the_spectrum_is_numpys(blank: Page) -> None:
    count = 3000
    made = rows(count)
    made["force_command"] = 2.0 + 0.5 * np.sin(2 * np.pi * 73.0 * made["time_s"])
    parts = [frame(made[start : start + 1000], start) for start in range(0, count, 1000)]
    found = store(
        blank,
        parts,
        """async (store) => {
            const { spectrum } = await import("/static/js/measure.js");
            const found = spectrum(store, "force", 0, store.head);
            return [Array.from(found.hz), Array.from(found.amplitude), found.rows];
        }""",
    )
    values = made["force_command"].astype(np.float32).astype(float)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(count) + 0.5) / count)
    expected = 4 * np.abs(np.fft.rfft((values - values.mean()) * window, 4096))[1:2048] / count
    np.testing.assert_allclose(found[1], expected, atol=1e-9)
    peak = int(np.argmax(found[1]))
    assert found[0][peak] == pytest.approx(73, abs=0.2)
    assert found[1][peak] == pytest.approx(0.5, rel=0.02)
    assert found[2] == count


def test_what_the_page_saves_the_server_reads(blank: Page) -> None:
    made = rows(5000, 10)
    made["encoder_counts"] = np.arange(5000) - 100
    made["wake_late_ns"] = 12_000
    parts = [frame(made[start : start + 1000], start) for start in range(0, 5000, 1000)]
    buffers = store(blank, parts, "(store) => store.frames(100, 4900).map((part) => Array.from(new Uint8Array(part)))")
    decoded = [decode(bytes(buffer)[4:])[0] for buffer in buffers]
    back = np.concatenate(decoded)
    for name in ("tick", "encoder_counts", "wake_late_ns"):
        np.testing.assert_array_equal(back[name], made[name][100:4900])


def test_a_wheel_zooms_and_a_drag_scrolls_back(open_page: Open) -> None:
    page = open_page()
    lane = page.locator(".lane .u-over").first
    box = lane.bounding_box()
    assert box is not None
    captures(page, 2100)
    before = float(page.locator("body").get_attribute("data-seen") or 0)
    page.mouse.move(box["x"] + 300, box["y"] + 20)
    page.mouse.wheel(0, -100)
    drawn(page)
    assert float(page.locator("body").get_attribute("data-seen") or 0) == pytest.approx(0.8 * before, rel=0.05)
    page.mouse.down()
    page.mouse.move(box["x"] + 500, box["y"] + 20, steps=5)
    page.mouse.up()
    assert page.locator("#run").inner_text() == "Run"
