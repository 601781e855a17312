"""The second way to stop: one word in a datagram to a thread of the daemon that uses neither its API nor its interpreter.

It works even if the API is overloaded, frozen, or out of descriptors. It uses only the standard library, for a quick import.
"""

from __future__ import annotations

import os
import socket
import time
from pathlib import Path
from typing import Final, Literal

Word = Literal["stop", "estop"]

LATE: Final = "late"
"""Answer: the word has arrived, but the servo loop has not stopped within the daemon's waiting time."""
_LONGEST_ANSWER: Final = 32


def ask(socket_path: Path, word: Word, timeout_s: float = 0.3) -> str | None:
    """Send a word to the daemon's stop channel, and wait for its answer.

    Args:
        socket_path: of the daemon's control API; the channel is in the same folder.
        word: ``stop``, or ``estop``, which latches a fault.
        timeout_s: longest wait, s.

    Returns:
        The new state of the servo loop, ``off`` or ``fault``, both at zero current; `LATE`; or None: there is no channel, no
        permission, or no answer.
    """
    deadline = time.monotonic() + timeout_s
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
            # An address from the kernel (unix(7), autobind), to which the daemon can answer.
            channel.bind("")
            # On a connected socket the kernel accepts datagrams from the daemon only, so no one else can fake an answer.
            channel.connect(f"{os.fspath(socket_path)}.stop")
            channel.settimeout(timeout_s)
            channel.send(word.encode())
            channel.settimeout(max(deadline - time.monotonic(), 0.001))
            return channel.recv(_LONGEST_ANSWER).decode("ascii", "replace")
    except OSError:
        return None
