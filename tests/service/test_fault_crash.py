"""A daemon that is killed at any step of a fault comes up with that fault latched, and with its numbers."""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest

from hapticd.client import DaemonUnreachable, RequestRefused
from tests.forked import Forked
from tests.polling import PATIENCE_S, wait_until
from tests.service.crashing_daemon import STEPS
from tests.service.processes import Rig

pytestmark = pytest.mark.realtime

CRASHING = "tests.service.crashing_daemon:main"
SAMPLE = (("notice", "before"), ("rename", "before"), ("log", "before"))
EVERY = tuple((step, when) for step in STEPS for when in ("before", "after"))


def crash_and_come_back(folder: Path, step: str, when: str) -> None:
    rig = Rig(folder, safety={"guard": "off", "max_excursion": 1.0, "heartbeat_timeout_s": 5})
    words = [step, when, "run", str(rig.config), "--socket", str(rig.socket)]
    process = Forked(CRASHING, words, folder, rig.environment, rig.output)
    rig.processes.append(process)
    try:
        wait_until(lambda: process.poll() is not None or rig.answers(), "an answering daemon", 250)
        rig.client.start()
        with contextlib.suppress(DaemonUnreachable, RequestRefused):
            rig.client.set({"spring.origin": 2.0})  # farther from the shaft than the limit allows
        process.wait(PATIENCE_S)
        assert process.returncode == -9, rig.output.read_text()
        rig.launch()
        fault = rig.client.status()["fault"]
        assert fault is not None, rig.output.read_text()
        assert fault["code"] == "excursion"
        assert "is beyond safety.max_excursion = 1 rad" in fault["cause"]
        assert fault["from_before"]
        with pytest.raises(RequestRefused, match="excursion"):
            rig.client.start()
        rig.client.clear()
        assert rig.client.status()["state"] == "off"
    finally:
        for each in rig.processes:
            each.close()


@pytest.mark.parametrize(("step", "when"), SAMPLE)
def test_a_crash_in_a_fault_loses_no_fault(tmp_path: Path, step: str, when: str) -> None:
    crash_and_come_back(tmp_path, step, when)


@pytest.mark.attack
@pytest.mark.parametrize(("step", "when"), EVERY)
def test_a_crash_at_every_step_of_a_fault_loses_no_fault(tmp_path: Path, step: str, when: str) -> None:
    crash_and_come_back(tmp_path, step, when)
