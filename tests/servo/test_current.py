"""The trip `current_mismatch`: a current that is not the commanded one is found, and no honest device is accused."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm

from drivers.interface import X_CURRENT, X_CURRENT_MEASURED
from drivers.loopback import LoopbackDriver
from hapticd.config import Config, parse_config
from hapticd.record.schema import FLAG_FAULT, FLAG_RUNNING
from hapticd.servo import atomics, faults
from hapticd.servo import layout as w
from hapticd.servo.core import Request, ServoCore, parameters
from hapticd.servo.follow import transition
from tests.servo.scripted import Scripted, config, core_for, fault_code, rows_of

HELD = 2000
"""Counts from the origin at which the default spring asks for 0.63 A."""


class Measuring(Scripted):
    """A shaft that is held, on a device that measures what ``lie`` makes of the last command."""

    def __init__(self, cfg: Config, lie: Callable[[float], float]) -> None:
        super().__init__(cfg, lambda n: HELD)
        self.lie = lie
        self.lies = False

    def _read(self, words: NDArray[np.int64]) -> int:
        result = super()._read(words)
        floats = words.view(np.float64)
        floats[X_CURRENT_MEASURED] = self.lie(float(floats[X_CURRENT])) if self.lies else floats[X_CURRENT]
        return result


LIES: dict[str, Callable[[float], float]] = {
    "30 A": lambda current: 30.0,
    "-30 A": lambda current: -30.0,
    "opposite": lambda current: -current,
    "nothing": lambda current: 0.0,
    "half as much": lambda current: 0.4 * current,
    "infinite": lambda current: math.inf,
}


@pytest.mark.parametrize("rate_hz", [100.0, 1000.0, 10_000.0])
@pytest.mark.parametrize("lie", LIES)
def test_a_current_that_is_not_the_commanded_one_is_a_fault(lie: str, rate_hz: float) -> None:
    cfg = config(servo={"rate_hz": rate_hz}, amplifier={"bandwidth_hz": 300.0})
    driver = Measuring(cfg, LIES[lie])
    core = core_for(driver, cfg)
    honest = rows_of(core, round(0.1 * rate_hz))
    assert abs(honest["current_command_A"][-1]) > 0.6
    assert fault_code(core) is None
    driver.lies = True
    rows = rows_of(core, round(0.15 * rate_hz))
    assert fault_code(core) == "current_mismatch"
    lasted = int(np.argmax(rows["flags"] & FLAG_FAULT != 0)) / rate_hz
    assert lasted == pytest.approx(cfg.safety.current_mismatch_s, abs=0.02 + 3 / rate_hz)
    assert driver.commands[-1] == (0.0, False)
    value, limit = core.fault_numbers
    text = faults.describe(faults.CURRENT_MISMATCH, value, limit, is_linear=False)["cause"]
    assert f"measures {value:.4g} A" in text


@pytest.mark.parametrize(
    ("safety", "lie"),
    [
        ({"current_mismatch": None}, "30 A"),
        ({"current_mismatch": 0}, "opposite"),
        ({"current_mismatch": 2.0}, "opposite"),
        ({"current_mismatch_s": 1.0}, "30 A"),
        ({}, "slightly more"),
        ({}, "not measured"),
    ],
)
def test_what_is_none(safety: dict[str, Any], lie: str) -> None:
    cfg = config(safety=safety)
    driver = Measuring(cfg, {**LIES, "slightly more": lambda c: c - 0.25, "not measured": lambda c: math.nan}[lie])
    driver.lies = True
    core = core_for(driver, cfg)
    rows = rows_of(core, 500)
    assert fault_code(core) is None
    assert rows["flags"][-1] & FLAG_RUNNING


def test_in_ready_a_current_is_one_too_many_but_not_in_off() -> None:
    for state, expected in ((w.OFF, None), (w.READY, "current_mismatch")):
        driver = Measuring(config(), LIES["30 A"])
        driver.lies = True
        core = core_for(driver, driver.config, state)
        rows_of(core, 300)
        assert fault_code(core) == expected


@given(turned=st.floats(1e-6, 100.0), damping=st.floats(0.01, 10.0) | st.just(1.0) | st.floats(1 - 1e-9, 1 + 1e-9))
def test_the_transition_is_the_exponential_of_the_amplifiers_matrix(turned: float, damping: float) -> None:
    exact = expm(np.array([[0.0, 1.0], [-1.0, -2.0 * damping]]) * turned)
    assert np.reshape(transition(turned, damping), (2, 2)) == pytest.approx(exact, abs=1e-9)


def storm(rate_hz: float, bandwidth_hz: float, damping: float, is_delay: bool, seed: int, seconds: float) -> ServoCore:
    """Starts, stops, releases into saturation, dither and T_V that change all the time, on a device that does as told.

    Args:
        rate_hz: servo rate. bandwidth_hz: of the amplifier, Hz. damping: its damping ratio.
        is_delay: it is the theory's pure delay; else a current loop of second order.
        seed: of what happens. seconds: of virtual time.
    """
    random = np.random.default_rng(seed)
    base: dict[str, Any] = {
        "servo": {"rate_hz": rate_hz},
        "amplifier": {"bandwidth_hz": bandwidth_hz, "damping_ratio": damping, "continuous_current": None},
        "safety": {"max_velocity": None, "max_excursion": None, "encoder_jump": None},
    }
    cfg = parse_config(base, "storm")
    exact: dict[str, Any] = base
    if bandwidth_hz and not is_delay:
        lag = {"name": "amplifier_lag", "f_a": bandwidth_hz, "delta": damping}
        exact = {**base, "amplifier": {**base["amplifier"], "bandwidth_hz": 0}, "plant": {"effects": [lag]}}
    driver = LoopbackDriver(parse_config(exact, "device"))
    driver.open()
    core = ServoCore(driver, ring_rows=16, excitation_rows=1)
    pool = []
    for _ in range(12):
        sections: dict[str, Any] = {
            "spring": {"stiffness": float(random.choice([0.0, 0.005, 0.05, 1.0]))},
            "delay": {"computation_s": float(random.choice([0.0, 0.3, 1.0, 2.7, 20.0])) / rate_hz},
            "safety": {**base["safety"], "soft_start_s": float(random.choice([0.0, 0.1]))},
        }
        if random.random() < 0.6:
            waveform = str(random.choice(["sine", "square", "triangle", "uniform"]))
            frequency = 0.0 if waveform == "uniform" else float(random.uniform(1.0, 0.49 * rate_hz))
            sections["dither"] = {
                "target": "current", "waveform": waveform, "frequency_hz": frequency,
                "amplitude": float(random.uniform(0.1, 6.0)),
            }  # fmt: skip
        pool.append(parse_config({**base, **sections}, "storm"))
    core.publish(parameters(cfg, Request(state=w.RUNNING)))
    core.begin(0)
    done = 0
    while done < seconds * rate_hz:
        state = w.RUNNING if random.random() < 0.85 else w.OFF
        origin = int(random.choice([0, 10, 2000, -8000, 30_000]))
        request = Request(state=state, origin_counts=origin, exact=bool(random.random() < 0.5))
        core.publish(parameters(pool[random.integers(len(pool))], request))
        ticks = max(1, round(random.choice([0.003, 0.02, 0.1, 0.5]) * rate_hz))
        core.run(real_time=False, ticks=ticks)
        done += ticks
        if core.load(atomics.FAULT_CODE):
            break
    return core


@settings(deadline=None)
@given(
    rate_hz=st.sampled_from([100.0, 333.0, 1000.0, 3000.0, 10_000.0]),
    bandwidth_hz=st.sampled_from([0.0, 100.0, 300.0, 1000.0, 10_000.0]),
    damping=st.sampled_from([0.1, 0.7, 1.0, 3.0]),
    is_delay=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_no_storm_makes_an_honest_device_a_liar(
    rate_hz: float, bandwidth_hz: float, damping: float, is_delay: bool, seed: int
) -> None:
    core = storm(rate_hz, bandwidth_hz, damping, is_delay, seed, seconds=10_000.0 / rate_hz)
    assert fault_code(core) is None


@pytest.mark.attack
@pytest.mark.parametrize("rate_hz", [100.0, 1000.0, 10_000.0])
@pytest.mark.parametrize("bandwidth_hz", [0.0, 100.0, 1000.0, 10_000.0])
def test_an_hour_of_storms(rate_hz: float, bandwidth_hz: float) -> None:
    """Five minutes for each of the twelve, half of them with either kind of amplifier."""
    for is_delay in (True, False):
        core = storm(rate_hz, bandwidth_hz, 0.7, is_delay, int(rate_hz + bandwidth_hz), seconds=150.0)
        assert fault_code(core) is None
