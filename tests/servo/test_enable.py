"""The enable that a person holds: no current in a tick that read it released, and none after it without a new start."""

from __future__ import annotations

import random

import pytest

from drivers import DriverConfigError, check_option_names
from drivers.loopback import LoopbackDriver
from hapticd.config import LIVE_KEYS, Config
from hapticd.servo import atomics
from hapticd.servo import layout as w
from hapticd.servo.core import Request, ServoCore, parameters
from tests.servo.scripted import Scripted, config, core_for, fault_code, rows_of

CLEAR = LATER = 10**12  # ns: later than every fault and release here


class Switched(Scripted):
    """A device with an enable input; a finger at the switch."""

    enable_input = True

    def __init__(self, cfg: Config) -> None:
        super().__init__(cfg, lambda n: 100)
        self.held = True

    def enable_held(self) -> bool:
        return self.held


def test_released_is_zero_in_the_same_tick_and_latched() -> None:
    driver = Switched(config(safety={"enable": True}))
    core = core_for(driver, driver.config)
    assert rows_of(core, 20)["current_command_A"][-1] != 0.0
    driver.held = False
    row = rows_of(core, 1)
    assert row["current_command_A"][0] == 0.0
    assert driver.commands[-1] == (0.0, True)
    assert fault_code(core) == "enable_released"
    driver.held = True
    rows_of(core, 20)
    assert core.load(atomics.MODE) == w.FAULT
    assert driver.commands[-1] == (0.0, False)


def test_asked_for_while_released_the_amplifier_stays_off() -> None:
    driver = Switched(config(safety={"enable": True}))
    driver.held = False
    core = core_for(driver, driver.config)
    rows_of(core, 20)
    assert fault_code(core) == "enable_released"
    assert set(driver.commands) == {(0.0, False)}


def test_a_command_from_before_a_release_moves_nothing_once_it_is_held_again() -> None:
    """One that waits somewhere, or a sequence between two motions: a release in ``off`` is no fault."""
    driver = Switched(config(safety={"enable": True}))
    core = core_for(driver, driver.config, state=w.OFF)
    rows_of(core, 5)
    sent = int(core.next_instant()[0]) - 1
    driver.held = False
    rows_of(core, 5)
    driver.held = True
    rows_of(core, 5)
    core.publish(parameters(driver.config, Request(state=w.RUNNING, ordinal=sent)))
    rows_of(core, 20)
    assert fault_code(core) is None
    assert set(driver.commands) == {(0.0, False)}
    core.publish(parameters(driver.config, Request(state=w.RUNNING, ordinal=LATER)))
    assert rows_of(core, 20)["current_command_A"][-1] != 0.0


def test_who_does_not_ask_for_it_is_not_stopped_by_it() -> None:
    driver = Switched(config())
    driver.held = False
    core = core_for(driver, driver.config)
    assert rows_of(core, 20)["current_command_A"][-1] != 0.0


@pytest.mark.parametrize("seed", range(20))
def test_no_current_without_a_hand_and_none_again_without_a_start(seed: int) -> None:
    """Press, release, start, stop, clear and missed samples in any order, with and without a delay T_V."""
    chance = random.Random(seed)
    driver = Switched(
        config(safety={"enable": True, "missed_exchanges": 5}, delay={"computation_s": 0.0015 * (seed % 2)})
    )
    driver.held = False
    missed = False
    driver.script = lambda n: None if missed else 100
    core = core_for(driver, driver.config, state=w.OFF)
    clears = CLEAR
    may_move, moved, read_held = False, 0, False
    for _ in range(4000):
        action = chance.choice(("press", "press", "release", "start", "start", "stop", "clear", "wait", "wait", "miss"))
        missed = action == "miss"
        if action in ("press", "release"):
            driver.held = action == "press"
        elif action in ("start", "stop"):
            core.publish(
                parameters(
                    driver.config,
                    Request(state=w.RUNNING if action == "start" else w.OFF, ordinal=LATER, clear=clears),
                )
            )
            may_move = action == "start"
        elif action == "clear":
            clears += 1
            core.publish(parameters(driver.config, Request(state=w.OFF, clear=clears)))
            may_move = False
        for _ in range(chance.choice((1, 1, 4))):
            rows_of(core, 1)
            read_held = driver.held
            may_move = may_move and read_held
            current, _ = driver.commands[-1]
            assert current == 0.0 or may_move
            moved += current != 0.0
    assert moved > 50


def test_loopback_has_one() -> None:
    cfg = config(safety={"enable": True})
    driver = LoopbackDriver(cfg)
    driver.open()
    core = ServoCore(driver, ring_rows=1024, excitation_rows=256)
    core.publish(parameters(cfg, Request(state=w.RUNNING)))
    core.begin(0)
    core.run(real_time=False, ticks=20)
    assert core.load(atomics.MODE) == w.RUNNING
    driver.held = False
    core.run(real_time=False, ticks=1)
    assert fault_code(core) == "enable_released"
    assert core.load(atomics.HELD) == 0


def test_a_driver_without_one_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LoopbackDriver, "enable_input", False)
    with pytest.raises(
        DriverConfigError, match=r"safety.enable = true: driver loopback has no enable input.*: .*serial_dac"
    ):
        check_option_names(config(safety={"enable": True}))
    assert "safety.enable" not in LIVE_KEYS
