"""A device that is unplugged and plugged in again: opened again by itself, and nothing moves until a person clears."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from hapticd.config import Config, parse_config
from hapticd.service import reconnect
from hapticd.service.daemon import Daemon
from hapticd.service.latch import FaultLatch
from hapticd.service.refusals import Refused
from hapticd.servo import faults
from tests.polling import wait_until
from tests.sim_hw.boards import running_board

from .daemons import SOCKET, daemon_on, state_home, wait_for_state
from .test_daemon import run_for

__all__ = ["state_home"]

UNPLUGGED_S = 3.0


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reconnect, "RETRY_S", 0.1)


def config(link: Path, runs: Path, *, again: bool) -> Config:
    data = {
        "servo": {"rate_hz": 500, "overrun": {"fault_after": None}},
        "driver": {"name": "serial_dac", "port": str(link), "watchdog_ms": 200, "reconnect": again},
        "safety": {"heartbeat_timeout_s": 10, "missed_exchanges": 1000},
        "record": {"directory": str(runs)},
    }
    return parse_config(data, "test")


@pytest.mark.parametrize("again", [True, False])
def test_a_serial_board_that_is_replugged(tmp_path: Path, *, again: bool) -> None:
    script = f"faults: [{{at_s: 0.3, from: enabled, kind: unplug, duration_s: {UNPLUGGED_S}}}]"
    with running_board(tmp_path, script) as board:
        daemon = Daemon(config(board.link, tmp_path / "runs", again=again), "rig.yaml", FaultLatch(SOCKET))
        try:
            daemon.start()
            fault = wait_for_state(daemon, "fault")["fault"]
            assert fault["code"] == "driver_lost"
            wait_until(FaultLatch(SOCKET).path.exists, "the latch on disk")
            assert fault["remedy"] == (faults.REOPENS if again else faults.REPLUG)
            with pytest.raises(Refused, match=r"the fault is still there: .*plug it in"):
                daemon.clear()
            wait_until(board.link.is_symlink, "the port's return")
            if not again:
                time.sleep(1.0)
                assert "plug it in" in daemon.status()["fault"]["remedy"]
                with pytest.raises(Refused, match="the fault is still there"):
                    daemon.clear()
                return
            wait_until(lambda: daemon.status()["fault"]["remedy"] == faults.REOPENED, "the device open again")
            found = daemon.status()
            assert (found["state"], found["fault"]["code"]) == ("fault", "driver_lost")
            assert found["fault"]["time"] == FaultLatch(SOCKET).load()["time"]  # type: ignore[index]
            with pytest.raises(Refused, match="a fault is latched"):
                daemon.start()
            assert daemon.clear()["state"] == "off"
            assert daemon.start()["state"] == "running"
            assert daemon.rig.wait_ticks(100)
            assert daemon.status()["state"] == "running"
        finally:
            daemon.shutdown()


def test_an_end_while_the_device_is_away_waits_for_nothing(tmp_path: Path) -> None:
    with running_board(tmp_path, "faults: [{at_s: 0.1, from: enabled, kind: unplug}]") as board:
        daemon = Daemon(config(board.link, tmp_path / "runs", again=True), None, FaultLatch(SOCKET))
        try:
            daemon.start()
            wait_for_state(daemon, "fault")
            time.sleep(0.5)
        finally:
            begin = time.monotonic()
            daemon.shutdown()
        assert time.monotonic() - begin < 5.0


def test_a_fault_knows_when_and_under_which_config_it_was_latched(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with daemon_on(monkeypatch, tmp_path, lambda n: 0) as (daemon, (device,)):
        run_for(daemon, device)
        found = daemon.estop()
        wait_until(FaultLatch(SOCKET).path.exists, "the latch on disk")
        first = daemon.status()["fault"]
        assert first["from_before"] is False
        assert (first["config"], first["config_digest"]) == ("re35 (built in)", found["config_digest"])
    with daemon_on(monkeypatch, tmp_path, lambda n: 0, spring={"stiffness": 0.001}) as (daemon, _):
        again = daemon.status()
        assert again["fault"] == {**first, "from_before": True}
        assert again["config_digest"] != first["config_digest"]
        assert daemon.clear()["fault"] is None
