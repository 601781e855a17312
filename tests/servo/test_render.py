"""One tick's arithmetic against eq. 2 written out by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.plant.noise import next_uniform
from hapticd.record.schema import FLAG_EXCITATION, FLAG_RUNNING
from hapticd.servo import atomics
from hapticd.servo import layout as w
from hapticd.servo.core import Request, parameters
from hapticd.servo.dither import periodic
from hapticd.servo.law import coarse_ticks, spring
from tests.servo.scripted import Scripted, config, core_for, rows_of

RAW = 2 * math.pi / 8192


@given(counts=st.integers(-(10**12), 10**12), decimation=st.integers(1, 10**6))
def test_coarse_ticks_floor_towards_minus_infinity(counts: int, decimation: int) -> None:
    assert coarse_ticks(counts, decimation) == math.floor(counts / decimation) or abs(counts) > 2**50
    assert coarse_ticks(counts, decimation) * decimation <= counts < (coarse_ticks(counts, decimation) + 1) * decimation


@settings(max_examples=200)
@given(
    relative=st.integers(-100_000, 100_000),
    decimation=st.integers(1, 3000),
    bias=st.booleans(),
    side=st.sampled_from(["both", "positive", "negative"]),
)
def test_spring_is_equation_2(relative: int, decimation: int, bias: bool, side: str) -> None:
    cfg = config(spring={"half_tick_bias": bias, "side": side}, encoder={"decimation": decimation})
    params = parameters(cfg, Request())
    force = spring(params, params, relative, 0.0, 0.0)
    tick = math.floor(relative / decimation)
    expected = -0.012 * decimation * RAW * (tick + (0.5 if bias else 0.0))
    if (side == "positive" and tick < 0) or (side == "negative" and tick >= 0):
        expected = 0.0
    assert force == pytest.approx(expected, rel=1e-13, abs=1e-18)


def test_bias_keeps_the_spring_from_ever_being_zero() -> None:
    params = parameters(config(encoder={"decimation": 217}), Request())
    forces = [spring(params, params, relative, 0.0, 0.0) for relative in range(-2000, 2000)]
    assert min(abs(force) for force in forces) == pytest.approx(0.5 * 0.012 * 217 * RAW, rel=1e-13)


@pytest.mark.parametrize(
    ("waveform", "values"), [(w.SINE, [0, 1, 0, -1]), (w.TRIANGLE, [0, 1, 0, -1]), (w.SQUARE, [1, 1, -1, -1])]
)
def test_waveforms_at_the_quarters(waveform: int, values: list[float]) -> None:
    assert [periodic(waveform, phase) for phase in (0.0, 0.25, 0.5, 0.75)] == pytest.approx(values, abs=1e-15)


def test_uniform_dither_is_uniform_and_repeatable() -> None:
    def draw(seed: int) -> list[float]:
        values = []
        for _ in range(20_000):
            seed, value = next_uniform(seed)
            values.append(value)
        return values

    sample = np.array(draw(7))
    assert draw(7) == list(sample)
    assert abs(np.corrcoef(sample[1:], sample[:-1])[0, 1]) < 0.03
    histogram, _ = np.histogram(sample, 20, (-1, 1))
    assert ((histogram - 1000) ** 2 / 1000).sum() < 43.8  # chi², 19 degrees of freedom, 0.1 %


def dithered(counts: int, ticks: int, **dither: Any) -> Any:
    driver = Scripted(config(encoder={"decimation": 100}, dither=dither), lambda n: counts)
    rows = rows_of(core_for(driver, driver.config), ticks)
    return rows[rows["flags"] & FLAG_RUNNING != 0]


def test_position_dither_moves_the_quantiser_and_not_the_recorded_ticks() -> None:
    # 90 counts of 100: a dither of ±0.2 tick crosses the edge at 1.0 only when it is above +0.1.
    rows = dithered(90, 400, target="position", waveform="sine", amplitude=0.2, frequency_hz=10.0)
    phase = 2 * np.pi * 10.0 * np.arange(len(rows)) / 1000
    level = np.floor(0.9 + 0.2 * np.sin(phase))
    assert rows["force_command"] == pytest.approx(-0.012 * 100 * RAW * (level + 0.5), rel=1e-12)
    assert set(level) == {0.0, 1.0}
    assert (rows["ticks"] == 0).all()


def test_current_dither_is_added_in_ampere() -> None:
    rows = dithered(90, 200, target="current", waveform="triangle", amplitude=0.3, frequency_hz=25.0)
    base = -0.012 * 100 * RAW * 0.5 / 0.0292
    extra = rows["current_command_A"] - base
    assert extra.max() == pytest.approx(0.3, abs=1e-12)
    assert extra.min() == pytest.approx(-0.3, abs=1e-12)
    assert np.abs(np.diff(extra)).max() == pytest.approx(0.3 * 4 * 25 / 1000, rel=1e-9)
    assert rows["force_command"] == pytest.approx(base * 0.0292, rel=1e-12)


def test_excitation_adds_current_and_moves_the_origin_in_step() -> None:
    driver = Scripted(config(encoder={"decimation": 10}), lambda n: 55)
    core = core_for(driver, driver.config, excitation_id=3, excitation_length=4)
    core.excitation[0, :4] = [0.1, 0.2, 0.0, 0.0]
    core.excitation[1, :4] = [0, 0, 20, -20]
    rows = rows_of(core, 12)
    running = rows[rows["flags"] & FLAG_RUNNING != 0]
    per_tick = 0.012 * 10 * RAW / 0.0292
    expected = [0.1 - 5.5 * per_tick, 0.2 - 5.5 * per_tick, -3.5 * per_tick, -7.5 * per_tick, -5.5 * per_tick]
    assert running["current_command_A"][:5] == pytest.approx(expected, rel=1e-12)
    assert list(running["flags"][:5] & FLAG_EXCITATION != 0) == [True] * 4 + [False]
    assert core.load(atomics.EXCITATION_DONE) == 3


def test_live_changes_do_not_bump_the_force() -> None:
    """Rate and decimation change while running: every row's force is the spring's own, for the setting of that row."""
    position = 1234
    driver = Scripted(config(encoder={"decimation": 217}), lambda n: position)
    core = core_for(driver, driver.config)
    first = rows_of(core, 20)
    slower = config(encoder={"decimation": 217}, servo={"rate_hz": 100})
    core.publish(parameters(slower, Request(state=w.RUNNING)))
    second = rows_of(core, 20)
    coarser = config(encoder={"decimation": 724}, servo={"rate_hz": 100})
    core.publish(parameters(coarser, Request(state=w.RUNNING)))
    third = rows_of(core, 20)
    assert set(second["force_command"]) == {first["force_command"][-1]}
    assert set(third["force_command"]) == {-0.012 * 724 * RAW * (position // 724 + 0.5)}
    assert np.diff(second["time_s"]) == pytest.approx(0.01)
    assert second["time_s"][0] - first["time_s"][-1] == pytest.approx(0.001)
    assert list(np.diff(np.concatenate([first["tick"], second["tick"], third["tick"]]))) == [1] * 59
    assert all((rows["flags"][3:] & FLAG_RUNNING != 0).all() for rows in (first, second, third))
