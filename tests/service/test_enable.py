"""The enable that a person holds, in the daemon: what is refused, what is latched, and that nothing starts by itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import drivers
from hapticd.service.daemon import Daemon
from hapticd.service.latch import FaultLatch
from hapticd.service.refusals import Refused
from tests.polling import wait_until
from tests.service.daemons import SOCKET, state_home, wait_for_state
from tests.servo.scripted import config
from tests.servo.test_enable import Switched

__all__ = ["state_home"]


@pytest.mark.realtime
def test_a_release_is_latched_and_only_a_start_with_the_switch_held_goes_on(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    device: list[Switched] = []

    def create(cfg: Any) -> Switched:
        device.append(Switched(cfg))
        device[-1].held = False
        return device[-1]

    monkeypatch.setattr(drivers, "create", create)
    cfg = config(
        servo={"overrun": {"fault_after": None}},
        safety={"enable": True, "heartbeat_timeout_s": 10, "enable_timeout_s": 20, "guard": "off"},
        record={"directory": str(tmp_path / "runs")},
    )
    daemon = Daemon(cfg, None, FaultLatch(SOCKET))
    try:
        switch = device[0]
        for begin in (daemon.start, lambda: daemon.release(5.0), lambda: daemon.excite("chirp")):
            with pytest.raises(Refused, match=r"the enable input is released .safety.enable.: hold it"):
                begin()
        assert daemon.status()["enable"] == {"required": True, "held": False}
        switch.held = True
        wait_until(lambda: daemon.status()["enable"]["held"], "the hand")
        assert daemon.status()["state"] == "off"
        daemon.start()
        wait_until(lambda: switch.commands[-1][0] != 0.0, "a current")
        switch.held = False
        assert wait_for_state(daemon, "fault")["fault"]["code"] == "enable_released"
        switch.held = True
        with pytest.raises(Refused, match=r"a fault is latched .enable_released"):
            daemon.start()
        daemon.clear()
        done = len(switch.commands)
        wait_until(lambda: len(switch.commands) > done + 20, "twenty ticks more")
        assert set(switch.commands[done:]) == {(0.0, False)}
        daemon.start()
        assert wait_for_state(daemon, "running")["fault"] is None
    finally:
        daemon.shutdown()
