"""Every trip: its code, its numbers, and what the device is told on the way out (zero first, then off, then silence)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from drivers import DEVICE_FAULT, LOST
from drivers.interface import X_DEVICE_CODE
from hapticd.record.schema import FLAG_CLAMPED, FLAG_FAULT, FLAG_MISSED_EXCHANGE, FLAG_RUNNING
from hapticd.servo import atomics, authority, faults
from hapticd.servo import layout as w
from hapticd.servo.core import Request, parameters
from tests.servo.scripted import Scripted, config, core_for, fault_code, rows_of

CLEAR = 10**12  # ns: later than every fault here
"""It came after what nobody asked for."""
Script = Callable[[int], Any]


def ends_at_zero(driver: Scripted) -> None:
    """The last command with current is followed by zero with the amplifier on, then by zero with it off, for ever."""
    currents = [index for index, (current, _) in enumerate(driver.commands) if current != 0.0]
    assert currents, "the test must have commanded a current, or it proves nothing"
    after = driver.commands[currents[-1] + 1 :]
    assert after[0] == (0.0, True)
    assert len(after) >= 2
    assert all(command == (0.0, False) for command in after[1:])


CASES: list[tuple[str, dict[str, Any], Script]] = [
    (
        "over_speed",
        {"safety": {"max_velocity": 50.0, "encoder_jump": None}},
        lambda n: 100 if n < 20 else 100 + 80 * (n - 20),
    ),
    ("excursion", {"safety": {"max_excursion": 1.0}}, lambda n: 100 + 20 * n),
    ("encoder_jump", {"safety": {"encoder_jump": 50}}, lambda n: 100 if n < 20 else 152),
    ("missed_exchanges", {"safety": {"missed_exchanges": 3}}, lambda n: 100 if n < 20 else None),
    ("driver_error", {}, lambda n: 100 if n < 20 else RuntimeError("bit rot in the counter")),
    ("over_current", {"spring": {"stiffness": 0.08}, "amplifier": {"peak_time_s": 0.01}}, lambda n: 1600),
]


@pytest.mark.parametrize(("code", "sections", "script"), CASES, ids=[case[0] for case in CASES])
def test_trip_latches_and_ends_at_zero(code: str, sections: dict[str, Any], script: Script) -> None:
    driver = Scripted(config(**sections), script)
    core = core_for(driver, driver.config)
    rows = rows_of(core, 200)
    assert fault_code(core) == code
    assert core.load(atomics.MODE) == w.FAULT
    ends_at_zero(driver)
    tripped = rows["flags"] & FLAG_FAULT != 0
    assert tripped.any()
    assert (rows["current_command_A"][tripped] == 0.0).all()
    assert not (rows["flags"][tripped] & FLAG_RUNNING).any()
    value, limit = core.fault_numbers
    described = faults.describe(faults.NUMBERS[code], float(value), float(limit), is_linear=False, detail=driver.error)
    if code == "driver_error":
        assert "bit rot in the counter" in described["cause"]
    else:
        assert abs(value) > limit
        assert f"{limit:.4g}" in described["cause"]


def test_the_exchange_too_many_ends_the_current_in_its_own_tick() -> None:
    driver = Scripted(config(safety={"missed_exchanges": 2}), lambda n: 100 if n < 20 else None)
    core = core_for(driver, driver.config)
    rows = rows_of(core, 40)
    first = np.flatnonzero(rows["flags"] & FLAG_MISSED_EXCHANGE)[0]
    assert fault_code(core) == "missed_exchanges"
    assert np.flatnonzero(rows["flags"] & FLAG_FAULT)[0] == first + 2
    assert (rows["current_command_A"][first : first + 2] != 0.0).all()
    assert (rows["current_command_A"][first + 2 :] == 0.0).all()


@pytest.mark.parametrize(
    ("result", "code", "text"),
    [
        (LOST, "driver_lost", "the device is lost (driver returned -2)"),
        (DEVICE_FAULT, "device_fault", "code 66 (0x42)"),
    ],
)
def test_device_that_goes_or_complains(result: int, code: str, text: str) -> None:
    driver = Scripted(config(), lambda n: 100)
    core = core_for(driver, driver.config)
    rows_of(core, 20)
    core.exchange[X_DEVICE_CODE] = 0x42
    driver.read_result = result
    rows_of(core, 5)
    assert fault_code(core) == code
    ends_at_zero(driver)
    value, limit = core.fault_numbers
    assert text in faults.describe(faults.NUMBERS[code], value, limit, is_linear=False)["cause"]


def test_no_motion_before_the_first_sample() -> None:
    """An amplifier that is on, an encoder that has not spoken yet: the loop waits, it does not guess."""
    driver = Scripted(config(safety={"missed_exchanges": None}), lambda n: None if n < 30 else 100)
    core = core_for(driver, driver.config)
    rows_of(core, 30)
    assert core.load(atomics.MODE) == w.READY
    assert {current for current, _ in driver.commands} == {0.0}
    rows_of(core, 5)
    assert core.load(atomics.MODE) == w.RUNNING


def test_clearing_does_not_forget_the_heat_of_the_winding() -> None:
    driver = Scripted(config(spring={"stiffness": 10.0}, safety={"max_excursion": None}), lambda n: 1000)
    core = core_for(driver, driver.config)
    core.run(real_time=False, ticks=1100)
    assert fault_code(core) == "over_current"
    core.publish(parameters(driver.config, Request(state=w.OFF, clear=CLEAR)))
    rows_of(core, 2)
    core.publish(parameters(driver.config, Request(state=w.RUNNING, clear=CLEAR)))
    core.run(real_time=False, ticks=50)
    assert fault_code(core) == "over_current"


def test_continuous_limit_without_a_peak_still_trips() -> None:
    driver = Scripted(
        config(spring={"stiffness": 10.0}, safety={"max_excursion": None}, amplifier={"peak_current": None}),
        lambda n: 500,
    )
    core = core_for(driver, driver.config)
    core.run(real_time=False, ticks=1000)
    assert fault_code(core) == "over_current"


def test_clamp_at_a_peak_off_the_dac_grid_never_exceeds_it() -> None:
    amplifier = {"dac_bits": 14, "peak_current": 2.0, "continuous_current": 2.0}
    driver = Scripted(
        config(spring={"stiffness": 10.0}, safety={"max_excursion": None}, amplifier=amplifier), lambda n: 1000
    )
    core = core_for(driver, driver.config)
    rows = rows_of(core, 300)
    assert fault_code(core) is None
    assert 1.999 < np.abs(rows["current_command_A"]).max() <= 2.0


def test_trip_that_just_does_not_happen() -> None:
    driver = Scripted(config(safety={"encoder_jump": 50}), lambda n: 100 if n < 20 else 151)
    core = core_for(driver, driver.config)
    rows_of(core, 100)
    assert fault_code(core) is None
    assert driver.commands[-1][0] != 0.0


def test_failing_write_is_followed_by_zero_at_once() -> None:
    driver = Scripted(config(), lambda n: 100)
    driver.fail_write_at = 10
    core = core_for(driver, driver.config)
    rows_of(core, 50)
    assert fault_code(core) == "driver_error"
    assert driver.error is not None
    assert "the cable is out" in driver.error
    assert driver.commands[10] == (0.0, True)
    assert driver.commands[11:] == [(0.0, False)] * len(driver.commands[11:])


def test_non_finite_command_never_leaves() -> None:
    driver = Scripted(config(), lambda n: 100)
    core = core_for(driver, driver.config, excitation_id=1, excitation_length=50)
    core.excitation[0, 20:] = math.nan
    rows_of(core, 60)
    assert fault_code(core) == "non_finite"
    assert all(math.isfinite(current) for current, _ in driver.commands)
    ends_at_zero(driver)


def test_clamp_at_the_peak_current() -> None:
    driver = Scripted(config(spring={"stiffness": 10.0}, safety={"max_excursion": None}), lambda n: 1000)
    core = core_for(driver, driver.config)
    rows = rows_of(core, 20)
    running = rows["flags"] & FLAG_RUNNING != 0
    assert (rows["current_command_A"][running] == -6.0).all()
    assert (rows["flags"][running] & FLAG_CLAMPED != 0).all()
    assert core.load(atomics.CLAMPED) == running.sum()


def test_the_i2t_is_in_a_word_that_outlives_the_process() -> None:
    cfg = config(amplifier={"continuous_current": 0.1, "peak_current": 6.0}, spring={"stiffness": 1.0})
    core = core_for(Scripted(cfg, lambda n: 100), cfg, w.RUNNING)
    assert atomics.heat(core.shared) == 0.0
    for _ in range(3):
        before = core.i2t
        core.run(real_time=False, ticks=5)
        assert atomics.heat(core.shared) == core.i2t > before


def test_i2t_trips_when_its_budget_is_spent() -> None:
    # 6 A against 2 A continuous uses up (36 - 4) A² x 1 s in exactly one second.
    driver = Scripted(config(spring={"stiffness": 10.0}, safety={"max_excursion": None}), lambda n: 1000)
    core = core_for(driver, driver.config)
    core.run(real_time=False, ticks=1000)
    assert fault_code(core) is None
    core.drain()
    core.run(real_time=False, ticks=5)
    assert fault_code(core) == "over_current"


def test_estop_from_running_and_from_off() -> None:
    driver = Scripted(config(), lambda n: 100)
    core = core_for(driver, driver.config)
    rows_of(core, 20)
    authority.estop(core.words, 1)
    rows_of(core, 5)
    assert fault_code(core) == "estop"
    ends_at_zero(driver)

    idle = Scripted(config(), lambda n: 100)
    core = core_for(idle, idle.config, state=w.OFF)
    authority.estop(core.words, 1)
    rows_of(core, 5)
    assert fault_code(core) == "estop"
    assert idle.commands == [(0.0, False)] * 5


def test_stop_is_zero_then_off() -> None:
    driver = Scripted(config(), lambda n: 100)
    core = core_for(driver, driver.config)
    rows_of(core, 20)
    core.publish(parameters(driver.config, Request(state=w.OFF)))
    rows_of(core, 5)
    assert core.load(atomics.MODE) == w.OFF
    ends_at_zero(driver)


def test_amplifier_that_never_enables_or_drops_out() -> None:
    driver = Scripted(config(safety={"enable_timeout_s": 0.05}), lambda n: 100)
    driver.obedient = False
    core = core_for(driver, driver.config)
    rows_of(core, 100)
    assert fault_code(core) == "enable_timeout"
    assert all(current == 0.0 for current, _ in driver.commands)

    driver = Scripted(config(), lambda n: 100)
    core = core_for(driver, driver.config)
    rows_of(core, 20)
    driver.obedient = False
    rows_of(core, 5)
    assert fault_code(core) == "amplifier_dropped"
    ends_at_zero(driver)


def test_a_fault_stays_until_cleared_and_the_motor_does_not_rearm() -> None:
    driver = Scripted(config(safety={"encoder_jump": 50}), lambda n: 100 if n < 20 else 200)
    core = core_for(driver, driver.config)
    rows_of(core, 50)
    assert fault_code(core) == "encoder_jump"
    core.publish(parameters(driver.config, Request(state=w.OFF)))
    rows_of(core, 5)
    core.publish(parameters(driver.config, Request(state=w.RUNNING)))
    rows_of(core, 5)
    assert core.load(atomics.MODE) == w.FAULT
    core.publish(parameters(driver.config, Request(state=w.OFF, clear=CLEAR)))
    rows_of(core, 5)
    assert core.load(atomics.MODE) == w.OFF
    assert fault_code(core) is None
    assert driver.commands[-1] == (0.0, False)
    core.publish(parameters(driver.config, Request(state=w.RUNNING, clear=CLEAR)))
    rows_of(core, 5)
    assert core.load(atomics.MODE) == w.RUNNING


def test_first_fault_is_the_one_that_is_kept() -> None:
    driver = Scripted(
        config(safety={"encoder_jump": 50}), lambda n: 100 if n < 20 else (300 if n < 25 else OSError("gone"))
    )
    core = core_for(driver, driver.config)
    rows_of(core, 50)
    assert fault_code(core) == "encoder_jump"
