"""``hapticd run`` in which one call for a resource fails: ``NUMBER COUNTER ARGUMENTS…``, 0 for none.

The calls are numbered from the start in the order in which they come; each adds a byte to the file COUNTER. Those of the
witness, which is the device, are its own affair.
"""

from __future__ import annotations

import builtins
import errno
import io
import mmap
import os
import socket
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Any

from hapticd.cli.main import main as hapticd

_WITNESS = "tests.service.witness"


def _refused(number: int) -> Callable[[], Exception]:
    return lambda: OSError(number, os.strerror(number))


CALLS: tuple[tuple[Any, str, Callable[[], Exception]], ...] = (
    (threading.Thread, "start", lambda: RuntimeError("can't start new thread")),
    (os, "open", _refused(errno.EMFILE)),
    (builtins, "open", _refused(errno.EMFILE)),
    (io, "open", _refused(errno.EMFILE)),
    (socket.socket, "__init__", _refused(errno.EMFILE)),
    (socket.socket, "accept", _refused(errno.EMFILE)),
    (os, "fsync", _refused(errno.EIO)),
    (os, "write", _refused(errno.ENOSPC)),
    (os, "pwrite", _refused(errno.ENOSPC)),
    (mmap, "mmap", _refused(errno.ENOMEM)),
    (os, "rename", _refused(errno.ENOSPC)),
    (os, "replace", _refused(errno.ENOSPC)),
)


def main(words: Sequence[str]) -> int:
    """Run the daemon; one call fails."""
    number, counter, *arguments = words
    count = _Count(int(number), counter)
    for owner, name, error in CALLS:
        setattr(owner, name, count.counted(getattr(owner, name), name, error))
    return hapticd(arguments)


class _Count:
    def __init__(self, failing: int, counter: str) -> None:
        self._failing, self._number = failing, 0
        self._lock = threading.Lock()
        self._write = os.write
        self._counter = os.open(counter, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)

    def counted(self, function: Any, name: str, error: Callable[[], Exception]) -> Any:
        def call(*arguments: Any, **keywords: Any) -> Any:
            if sys._getframe(1).f_globals.get("__name__") != _WITNESS:
                with self._lock:
                    self._number += 1
                    failing = self._number == self._failing
                self._write(self._counter, b"!" if failing else b".")
                if failing:
                    raise error()
            return function(*arguments, **keywords)

        return call
