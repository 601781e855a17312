"""Any one call for a thread, a descriptor, memory or room on the disk may fail: a stop works, and no fault is lost.

As SQLite is tested: a run without a failure counts the calls from the start of the daemon to a fault and its clearing; then
there is one run for each call, in which that one fails. A daemon may refuse to start, in words, with the motor off.
"""

from __future__ import annotations

import contextlib
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import pytest

from hapticd.client import DaemonUnreachable, RequestRefused
from tests.forked import Forked
from tests.polling import PATIENCE_S, wait_until
from tests.service.processes import Rig

pytestmark = pytest.mark.realtime

FAILING = "tests.service.failing_daemon:main"
SAMPLE, SHARES = 3, 8
SAFETY = {"guard": "off", "max_excursion": 1.0, "heartbeat_timeout_s": 5, "soft_start_s": 0}
TRIES = 3

Answer = TypeVar("Answer")


def told(ask: Callable[[], Answer]) -> Answer | None:
    """The answer, asked for a few times: one of them may be what fails; None where all of them do."""
    for _ in range(TRIES):
        with contextlib.suppress(DaemonUnreachable, RequestRefused):
            return ask()
    return None


def status(rig: Rig) -> dict[str, Any]:
    """What the daemon says of itself."""
    found = told(rig.client.status)
    assert found is not None, rig.output.read_text()
    return found


def play(folder: Path, number: int) -> int:
    """From the start to a fault, a restart and its clearing, with that call failing; how many there were."""
    folder.mkdir()
    rig, counter = Rig(folder, safety=SAFETY), folder / "calls"
    words = [str(number), str(counter), "run", str(rig.config), "--socket", str(rig.socket)]
    process = Forked(FAILING, words, folder, rig.environment, rig.output)
    rig.processes.append(process)
    try:
        wait_until(lambda: process.poll() is not None or rig.answers(), "an answering daemon", 250)
        if process.poll() is not None:
            assert process.returncode in (2, 4), rig.output.read_text()
            assert not (rig.log.exists() and any(line[0] in "-123456789" for line in rig.commands()))
            return 0
        told(rig.client.start)
        told(lambda: rig.client.set({"spring.origin": 2.0}))  # farther from the shaft than the limit allows
        wait_until(lambda: is_off(rig), "a fault, or never a start")
        faulted = status(rig)["fault"] is not None
        assert told(rig.client.stop) is not None, rig.output.read_text()
        assert is_off(rig)
        process.terminate()
        process.wait(PATIENCE_S)
        assert process.returncode == (5 if faulted else 0), rig.output.read_text()
        assert rig.commands()[-1] == "closed"
        assert rig.commands()[-2] == "0.0 0"
        rig.launch()
        fault = rig.client.status()["fault"]
        assert (fault is not None) == faulted, rig.output.read_text()
        assert fault is None or fault["code"] == "excursion"
        rig.client.clear()
        assert rig.client.status()["state"] == "off"
        return counter.stat().st_size
    finally:
        for each in rig.processes:
            each.close()


def is_off(rig: Rig) -> bool:
    return status(rig)["state"] in ("off", "fault")


def test_a_call_that_fails_loses_no_stop_and_no_fault(tmp_path: Path) -> None:
    calls = play(tmp_path / "0", 0)
    assert calls > 20
    for number in random.Random(7).sample(range(1, calls + 1), SAMPLE):
        play(tmp_path / str(number), number)


@pytest.mark.attack
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("share", range(SHARES))
def test_every_call_that_fails_loses_no_stop_and_no_fault(share: int, tmp_path: Path) -> None:
    calls = play(tmp_path / "0", 0)
    violations = []
    for number in range(1 + share, calls + 1, SHARES):
        try:
            play(tmp_path / str(number), number)
        except (AssertionError, DaemonUnreachable, RequestRefused, TimeoutError) as error:
            violations.append(f"call {number}: {type(error).__name__}: {error}")
    assert not violations, f"{len(violations)} of share {share} of {calls} calls\n" + "\n".join(violations)
