"""A command line with a controlling terminal of its own, or with none, whatever the tests run on."""

from __future__ import annotations

import fcntl
import os
import signal
import termios
from collections.abc import Sequence

from hapticd.cli.main import main as hapticd


def main(arguments: Sequence[str]) -> int:
    """What ``hapticd`` does in a window of its own, which is its standard error."""
    os.setsid()
    fcntl.ioctl(2, termios.TIOCSCTTY, 0)
    return hapticd(arguments)


def detached(arguments: Sequence[str]) -> int:
    """The same as a service: without a terminal."""
    os.setsid()
    return hapticd(arguments)


def nohup(arguments: Sequence[str]) -> int:
    """The same behind ``nohup``."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    return main(arguments)
