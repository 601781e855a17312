"""What keeps a test true on a busy machine: waiting with a deadline, and a multicast group of its own."""

from __future__ import annotations

import random
import time
from collections.abc import Callable

import pytest

PATIENCE_S = 180.0
"""Longest wait for what must come: only there so that a broken test ends."""


def wait_until(condition: Callable[[], bool], what: str, timeout_s: float = PATIENCE_S) -> None:
    """Poll a condition every 10 ms; the test fails with ``what`` when it never holds."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail(f"never happened: {what}")
        time.sleep(0.01)


def multicast_group() -> str:
    """A group for udp_multicast that no other test run on this machine is likely to use."""
    return f"239.74.{random.randrange(256)}.{random.randrange(1, 255)}"
