"""Which tests run against the wall clock, and what follows from it.

Those that compute are run side by side; those that ask when something happened, of threads, processes or the servo loop in
real time, are run after them, two at a time. Between them are those that start processes and wait for what must come: they
run beside the first. On a shared machine without a real-time kernel a test of both latter kinds may meet a stall of a tenth
of a second: it is then repeated, at most twice, and the summary names it (docs/decisions/0014-two-kinds-of-tests.md).
"""

from __future__ import annotations

import functools
import signal
from pathlib import Path

import pytest
from xdist import is_xdist_controller

from tests.forked import fork_what_hil_starts, start_server

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell's job in the background, as a CI may be, begins with SIGINT ignored, and so would every process of the tests.
    signal.signal(signal.SIGINT, signal.default_int_handler)

TESTS = Path(__file__).parent
WALL_CLOCK = (
    "drivers/canopen/test_callback.py",
    "drivers/canopen/test_exchange.py",
    "drivers/canopen/test_simulated_drive.py",
    "drivers/serial/test_exchange.py",
    "drivers/serial/test_port.py",
    "drivers/serial/test_session.py",
    "drivers/test_libc.py",
    "drivers/test_seqpacket_bus.py",
    "gap/test_live_story.py",
    "hil/test_hil.py",
    "hil/test_passivity.py",
    "record/test_recorder.py",
    "service/test_access.py",
    "service/test_api.py",
    "service/test_banner.py",
    "service/test_daemon.py",
    "service/test_fault_crash.py",
    "service/test_guard.py",
    "service/test_heat.py",
    "service/test_latch.py",
    "service/test_live.py",
    "service/test_metrics.py",
    "service/test_notify.py",
    "service/test_process.py",
    "service/test_reconnect.py",
    "service/test_release.py",
    "service/test_resource_failures.py",
    "service/test_socket.py",
    "service/test_stop_means_stop.py",
    "service/test_things_taken_away.py",
    "service/test_unread.py",
    "servo/test_heartbeat.py",
    "servo/test_mailbox.py",
    "servo/test_overrun.py",
    "servo/test_stop_channel.py",
)
PATIENT = (
    "docs/test_notebooks.py",
    "doctor/test_board.py",
    "doctor/test_terminal.py",
    "drivers/canopen/test_bring_up.py",
    "record/test_crash.py",
    "scope",
    "sim_hw/canopen",
    "sim_hw/test_faults.py",
    "sim_hw/test_port.py",
    "sim_hw/test_truth.py",
)
"""They wait for events, for many seconds if need be, and take times from the device's own log."""
REPEATS = 2


@functools.cache
def _is_among(path: Path, places: tuple[str, ...]) -> bool:
    return any(path.relative_to(TESTS).is_relative_to(place) for place in places)


def pytest_sessionstart(session: pytest.Session) -> None:
    """With ``-m realtime`` nearly all devices and daemons are forked: their server loads beside the collection."""
    runs_tests = not session.config.option.collectonly and not is_xdist_controller(session)
    if session.config.option.markexpr == "realtime" and runs_tests:
        start_server()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """With ``-m realtime`` leave out the files that name no such test: importing them all takes seconds."""
    if config.option.markexpr != "realtime" or not collection_path.name.startswith("test_") or collection_path.is_dir():
        return None
    return None if _is_among(collection_path, WALL_CLOCK) or "realtime" in collection_path.read_text() else True


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what runs against the wall clock ``realtime``, and have it and what waits repeated when it fails.

    What an attack finds once is found: nothing of it is repeated.
    """
    for item in items:
        if _is_among(item.path, WALL_CLOCK):
            item.add_marker(pytest.mark.realtime)
        waits = _is_among(item.path, PATIENT) or item.get_closest_marker("realtime")
        if waits and not item.get_closest_marker("attack"):
            item.add_marker(pytest.mark.flaky(reruns=REPEATS))


@pytest.fixture
def forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Devices and daemons of `hapticd.hil` begin in milliseconds."""
    fork_what_hil_starts(monkeypatch)
