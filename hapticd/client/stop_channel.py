"""The second way to a stop: one word in a datagram to a thread of the daemon that needs neither its API nor its interpreter.

It works while the API is flooded, frozen, or out of descriptors. Plain standard library, so that it is quick to import.
"""

from __future__ import annotations

import os
import socket
import time
from pathlib import Path
from typing import Final, Literal

Word = Literal["stop", "estop"]

LATE: Final = "late"
"""Answer: the word has arrived, and the servo loop had not obeyed when the daemon gave up waiting for it."""
_LONGEST_ANSWER: Final = 32


def ask(socket_path: Path, word: Word, timeout_s: float = 0.3) -> str | None:
    """Say a word to the daemon's stop channel, and wait for its answer.

    Args:
        socket_path: of the daemon's control API; the channel lies beside it.
        word: ``stop``, or ``estop``, which latches a fault.
        timeout_s: longest wait, s.

    Returns:
        The state in which the servo loop is now, ``off`` or ``fault``, both at zero current; `LATE`; or None: there is no
        such channel, we may not write to it, or nothing answers.
    """
    deadline = time.monotonic() + timeout_s
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
            # A name that the kernel chooses (unix(7), autobind): without one there is nowhere to answer to.
            channel.bind("")
            # Connected, the kernel takes no datagram from anybody else: who finds our name cannot say that it is off.
            channel.connect(f"{os.fspath(socket_path)}.stop")
            channel.settimeout(timeout_s)
            channel.send(word.encode())
            channel.settimeout(max(deadline - time.monotonic(), 0.001))
            return channel.recv(_LONGEST_ANSWER).decode("ascii", "replace")
    except OSError:
        return None
