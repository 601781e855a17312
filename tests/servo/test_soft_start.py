"""Transients: how far the current may jump where running begins and where the spring changes, from recordings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.loopback import LoopbackDriver
from hapticd.config import Config, apply_settings, parse_config
from hapticd.record.schema import FLAG_RUNNING
from hapticd.servo import layout as w
from hapticd.servo.core import Request, ServoCore, parameters
from hapticd.servo.simulate import simulate
from hapticd.stability.passivity import spring_potential
from tests.servo.scripted import Scripted, config, core_for, rows_of

HELD = 2000
FULL = -0.012 * (HELD + 0.5) * config().raw_resolution / 0.0292
"""A: what the default spring asks for there."""
TICKS = 250
"""Of the default soft start at 1 kHz."""


def soft(**sections: Any) -> Config:
    """A config with the soft start that is the default."""
    return config(**{**sections, "safety": {"soft_start_s": 0.25, **sections.get("safety", {})}})


def running(rows: NDArray[Any]) -> NDArray[np.float64]:
    """Currents of the ticks in which the spring was rendered, A."""
    return np.asarray(rows["current_command_A"][rows["flags"] & FLAG_RUNNING != 0])


def test_the_force_comes_in_evenly_and_is_all_there_at_the_end() -> None:
    cfg = soft()
    core = core_for(Scripted(cfg, lambda n: HELD), cfg)
    currents = running(rows_of(core, 400))
    assert currents[: TICKS + 1] == pytest.approx(FULL * np.arange(TICKS + 1) / TICKS, abs=1e-12)
    assert currents[TICKS + 1 :] == pytest.approx(FULL, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "ratio"),
    [
        ({"spring.stiffness": 0.024}, 2.0),
        ({"spring.stiffness": 0}, 0.0),
        ({"spring.origin": 2 * HELD * config().raw_resolution}, -(HELD - 0.5) / (HELD + 0.5)),
        ({"spring.side": "negative"}, 0.0),
        ({"spring.half_tick_bias": False}, HELD / (HELD + 0.5)),
        ({"encoder.decimation": 1000}, 2500 / (HELD + 0.5)),
    ],
)
def test_a_live_change_passes_over_from_what_was_rendered(change: dict[str, Any], ratio: float) -> None:
    cfg = soft()
    core = core_for(Scripted(cfg, lambda n: HELD), cfg)
    rows_of(core, 400)
    core.publish(parameters(apply_settings(cfg, change, source="test"), Request(state=w.RUNNING)))
    currents = running(rows_of(core, 400))
    share = np.minimum(np.arange(400) / TICKS, 1.0)
    assert currents == pytest.approx(FULL * (1.0 + (ratio - 1.0) * share), abs=1e-12)


def test_a_change_in_the_middle_of_another_goes_on_from_there() -> None:
    cfg = soft()
    core = core_for(Scripted(cfg, lambda n: HELD), cfg)
    before = running(rows_of(core, 102))
    changed = apply_settings(cfg, {"spring.stiffness": 0.048}, source="test")
    core.publish(parameters(changed, Request(state=w.RUNNING)))
    after = running(rows_of(core, 400))
    steps = np.abs(np.diff(np.concatenate([before, after])))
    assert after[0] == pytest.approx(before[-1], abs=1.01 * abs(FULL) / TICKS)
    assert after[-1] == pytest.approx(4.0 * FULL, rel=1e-12)
    assert steps.max() <= 4.0 * abs(FULL) / TICKS * (1.0 + 1e-9)


@pytest.mark.parametrize("ticks_before_the_end", [0, 1, 2])
def test_a_change_that_meets_the_last_step_of_another_goes_on_from_there(ticks_before_the_end: int) -> None:
    """The tick that would have taken the last step takes the change's first one, and not both."""
    cfg = soft()
    core = core_for(Scripted(cfg, lambda n: HELD), cfg)
    before = running(rows_of(core, TICKS + 2 - ticks_before_the_end))
    changed = apply_settings(cfg, {"spring.stiffness": 0.006}, source="test")
    core.publish(parameters(changed, Request(state=w.RUNNING)))
    after = running(rows_of(core, 400))
    assert abs(after[0] - before[-1]) <= 1e-9 * abs(FULL)
    assert after[-1] == pytest.approx(0.5 * FULL, rel=1e-12)


def test_what_is_no_spring_changes_nothing_and_none_is_none() -> None:
    cfg = soft()
    core = core_for(Scripted(cfg, lambda n: HELD), cfg)
    rows_of(core, 400)
    core.publish(parameters(apply_settings(cfg, {"safety.max_velocity": 300}, source="test"), Request(state=w.RUNNING)))
    assert running(rows_of(core, 50)) == pytest.approx(FULL)
    at_once = apply_settings(cfg, {"safety.soft_start_s": 0, "spring.stiffness": 0.024}, source="test")
    core.publish(parameters(at_once, Request(state=w.RUNNING)))
    assert running(rows_of(core, 50)) == pytest.approx(2.0 * FULL)


def test_switched_off_in_the_middle_the_whole_force_is_there_at_once() -> None:
    cfg = soft()
    core = core_for(Scripted(cfg, lambda n: HELD), cfg)
    rows_of(core, 100)
    at_once = apply_settings(cfg, {"safety.soft_start_s": 0}, source="test")
    core.publish(parameters(at_once, Request(state=w.RUNNING)))
    assert running(rows_of(core, 50)) == pytest.approx(FULL)


@pytest.mark.parametrize("request_", [{"exact": True}, {"excitation_id": 1, "excitation_length": 100}])
def test_a_release_and_an_excitation_have_none(request_: dict[str, Any]) -> None:
    cfg = soft()
    core = core_for(Scripted(cfg, lambda n: HELD), cfg, **request_)
    assert running(rows_of(core, 50)) == pytest.approx(FULL)


def test_simulate_has_none_with_and_without_safety() -> None:
    assert parameters(soft(), Request(state=w.RUNNING), safety=False)["soft_step"] == 0.0
    for safety in (False, True):
        blocks: list[NDArray[Any]] = []
        simulate(
            soft(), 0.01, deflection=HELD, safety=safety, on_rows=lambda rows, kept=blocks: kept.append(rows.copy())
        )
        assert blocks[0]["current_command_A"][0] == pytest.approx(FULL, rel=1e-3)


def test_every_start_is_soft_anew() -> None:
    cfg = soft()
    core = core_for(Scripted(cfg, lambda n: HELD), cfg)
    for _ in range(2):
        currents = running(rows_of(core, 400))
        assert abs(currents[0]) <= abs(FULL) / TICKS
        core.publish(parameters(cfg, Request(state=w.OFF)))
        rows_of(core, 5)
        core.publish(parameters(cfg, Request(state=w.RUNNING)))


@pytest.mark.parametrize("path", ["in", "out", "to and fro"])
def test_the_passivity_observers_books_stay_exact(path: str) -> None:
    """Put out, less what the whole spring has stored less: what a soft start keeps back is booked, and what it adds, too."""
    places = {
        "in": lambda n: 2000 - 2 * n,
        "out": lambda n: 100 + 2 * n,
        "to and fro": lambda n: 100 + 20 * min(n, 400 - n),
    }
    cfg = soft(safety={"passivity": "observe", "max_velocity": None})
    core = core_for(Scripted(cfg, lambda n: places[path](min(n, 380))), cfg)
    rows = rows_of(core, 380)
    rows = rows[rows["flags"] & FLAG_RUNNING != 0]
    raw, counts, current = cfg.raw_resolution, rows["encoder_counts"], rows["current_command_A"]
    work = float(np.sum(current[:-1] * 0.0292 * np.diff(counts) * raw))
    stored = [0.012 * raw * raw * spring_potential(c + 0.5, 0.5, 0.0) for c in counts]
    books = core.passivity()
    assert books["put_out_J"] == pytest.approx(work, rel=1e-9)
    assert books["generated_J"] == pytest.approx(work + stored[-1] - stored[0], rel=1e-9)
    assert books["excess_J"] >= books["generated_J"] - 1e-12
    if path == "to and fro":
        assert books["generated_J"] > 0.0


def law(cfg: Config, counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Current that the spring of a config asks for at raw counts, A, within the peak."""
    n = np.floor((counts - cfg.origin_counts) / cfg.encoder.decimation)
    force = -cfg.spring.stiffness * cfg.resolution * (n + (0.5 if cfg.spring.half_tick_bias else 0.0))
    if cfg.spring.side == "positive":
        force = np.where((n < 0) | (force > 0), 0.0, force)
    peak = cfg.amplifier.peak_current or math.inf
    return np.clip(force / cfg.amplifier.torque_constant, -peak, peak)


def largest_excess(
    old: NDArray[np.float64], new: NDArray[np.float64], current: NDArray[np.float64], share: float
) -> float:
    """How far the worst step of the current is beyond its bound, A; the first of each is that of the tick before.

    The bound: a tick's share of the change, and what either spring changes by itself as the shaft moves.
    """
    own = np.maximum(np.abs(np.diff(old)), np.abs(np.diff(new)))
    apart = np.maximum(np.abs(new - old)[1:], np.abs(new - old)[:-1])
    return float(np.max(np.abs(np.diff(current)) - apart * share - own))


SPRINGS = st.fixed_dictionaries(
    {
        "spring.stiffness": st.integers(0, 500).map(lambda k: 1e-4 * k),
        "spring.origin": st.integers(-5000, 5000).map(lambda k: 1e-3 * k),
        "spring.side": st.sampled_from(["both", "positive"]),
        "spring.half_tick_bias": st.booleans(),
        "encoder.decimation": st.sampled_from([1, 10, 217]),
    }
)


@settings(deadline=None)
@given(
    first=SPRINGS,
    second=SPRINGS,
    rate_hz=st.sampled_from([200.0, 1000.0, 5000.0]),
    soft_start_s=st.floats(0.02, 1.0),
    place=st.floats(-5.0, 5.0),
    push=st.floats(-0.02, 0.02),
    after=st.floats(0.01, 0.5),
)
@example(
    first={"spring.stiffness": 0.0003, "spring.origin": 0.12, "spring.side": "positive", "encoder.decimation": 217},
    second={"spring.stiffness": 0.0001, "spring.origin": 0.123, "spring.side": "positive", "encoder.decimation": 217},
    rate_hz=200.0,
    soft_start_s=0.02,
    place=5.0,
    push=0.0,
    after=0.015625,
)
def test_no_jump_at_a_start_or_at_a_live_change(
    first: dict[str, Any],
    second: dict[str, Any],
    rate_hz: float,
    soft_start_s: float,
    place: float,
    push: float,
    after: float,
) -> None:
    """A shaft that swings as it likes, pushed by a hand; a start, and a change that may come in the middle of it."""
    safety = {"soft_start_s": soft_start_s, "max_velocity": None, "max_excursion": None, "encoder_jump": None}
    base = parse_config({"servo": {"rate_hz": rate_hz}, "safety": safety}, "test")
    before = apply_settings(base, first, source="test")
    changed = apply_settings(before, second, source="test")
    driver = LoopbackDriver(before, position=place)
    driver.open()
    driver.plant[5] = push
    core = ServoCore(driver, ring_rows=1 << 14, excitation_rows=1)
    core.publish(parameters(before, Request(state=w.RUNNING)))
    core.begin(0)
    core.run(real_time=False, ticks=max(5, round(after * rate_hz)))
    started = core.drain()
    core.publish(parameters(changed, Request(state=w.RUNNING)))
    core.run(real_time=False, ticks=round(1.1 * soft_start_s * rate_hz) + 5)
    rows = np.concatenate([started, core.drain()])
    on = rows["flags"] & FLAG_RUNNING != 0
    assert on.sum() > 10
    begin = int(np.argmax(on)) - 1
    counts, current = rows["encoder_counts"][begin:], rows["current_command_A"][begin:]
    share = 1.0 / (soft_start_s * rate_hz)
    # One step of the converter, half of it at either end.
    step = 2.0 * 6.0 / 2**14
    old, new, split = law(before, counts), law(changed, counts), len(started) - begin
    assert largest_excess(np.zeros(split), old[:split], current[:split], share) <= step
    if before == changed:
        return
    # Where the start was not over, what it had left to do fades along with the spring that it was for.
    left = current[split - 1] - old[split - 1]
    assert largest_excess(old[split - 1 :] + left, new[split - 1 :], current[split - 1 :], share) <= step
