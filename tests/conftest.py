"""Which tests run against the wall clock, and what follows from it.

Those that compute are run side by side; those that start processes, threads or the servo loop in real time are run one
after another. On a shared machine without a real-time kernel such a test may meet a stall of a tenth of a second: it is
then repeated, at most twice, and the summary names it (docs/decisions/0014-two-kinds-of-tests.md).
"""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # A shell's job in the background, as a CI may be, begins with SIGINT ignored, and so would every process of the tests.
    signal.signal(signal.SIGINT, signal.default_int_handler)

TESTS = Path(__file__).parent
WALL_CLOCK = (
    "docs/test_notebooks.py",
    "doctor/test_board.py",
    "doctor/test_terminal.py",
    "drivers/canopen/test_bring_up.py",
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
    "record/test_crash.py",
    "record/test_recorder.py",
    "scope/test_command.py",
    "scope/test_page.py",
    "scope/test_relay.py",
    "scope/test_scripts.py",
    "scope/test_tutorial.py",
    "service/test_access.py",
    "service/test_api.py",
    "service/test_banner.py",
    "service/test_daemon.py",
    "service/test_guard.py",
    "service/test_live.py",
    "service/test_metrics.py",
    "service/test_notify.py",
    "service/test_process.py",
    "service/test_reconnect.py",
    "service/test_release.py",
    "service/test_socket.py",
    "servo/test_mailbox.py",
    "sim_hw/canopen",
    "sim_hw/test_faults.py",
    "sim_hw/test_port.py",
    "sim_hw/test_truth.py",
)
REPEATS = 2


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what runs against the wall clock ``realtime``, and have it repeated when it fails."""
    for item in items:
        place = item.path.relative_to(TESTS)
        if any(place.is_relative_to(folder) for folder in WALL_CLOCK):
            item.add_marker(pytest.mark.realtime)
        if item.get_closest_marker("realtime"):
            item.add_marker(pytest.mark.flaky(reruns=REPEATS))
