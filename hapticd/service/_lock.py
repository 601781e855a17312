"""The daemon's lock: only one daemon per socket path, even if the socket's folder is removed.

It is a file in the state directory that no other user can open (mode 0600), locked with ``flock``: the kernel releases the
lock when the process ends. It is not in the socket's folder: any user could lock a folder that he may read, and with the
folder the lock would be removed.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path
from typing import Self

from hapticd.service.latch import daemon_name, state_directory

_LONGEST_PID = 16


class HeldError(Exception):
    """Another process has the lock.

    Attributes:
        pid: its process number; None if not written yet.
    """

    def __init__(self, pid: int | None) -> None:
        super().__init__(f"held by process {pid}")
        self.pid = pid


class DaemonLock:
    """The lock of the daemon on one socket, held from `take` to `release`.

    Attributes:
        path: of the file; its content is the holder's process number.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._descriptor = -1
        self._made: list[Path] = []

    @classmethod
    def take(cls, socket: Path) -> Self:
        """Take the lock of the daemon on a socket.

        Raises:
            HeldError: a running process has it.
            OSError: the file cannot be created or locked, for example in a read-only state directory.
        """
        lock = cls(state_directory() / f"{daemon_name(socket)}.lock")
        lock._take()
        return lock

    def mend(self) -> bool:
        """Take it again if its file was removed; returns whether it was. Raises as `take`."""
        if self._descriptor < 0 or self._is_ours():
            return False
        old = self._descriptor
        self._take()
        os.close(old)
        return True

    def release(self) -> None:
        """Remove the file, release the lock, and remove the folder if it was created for the lock. Safe to call twice."""
        if self._descriptor < 0:
            return
        with contextlib.suppress(OSError):
            if self._is_ours():
                # Removed before the release: a process that has opened the old file finds it locked, and opens the path
                # again.
                self.path.unlink()
        os.close(self._descriptor)
        self._descriptor = -1
        with contextlib.suppress(OSError):
            for folder in self._made:
                folder.rmdir()

    def _is_ours(self) -> bool:
        """Whether the file at the path is the locked one."""
        return _is_at(self.path, self._descriptor)

    def _take(self) -> None:
        folder = self.path.parent
        made = [place for place in (folder, *folder.parents) if not place.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        while True:
            flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
            descriptor = os.open(self.path, flags, 0o600)
            try:
                _lock(descriptor)
                if _is_at(self.path, descriptor):
                    os.fchmod(descriptor, 0o600)
                    os.ftruncate(descriptor, 0)
                    os.pwrite(descriptor, b"%d\n" % os.getpid(), 0)
                    break
            except BaseException:
                os.close(descriptor)
                raise
            os.close(descriptor)  # its holder removed it between our two steps
        self._descriptor, self._made = descriptor, self._made or made


def _lock(descriptor: int) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        text = os.pread(descriptor, _LONGEST_PID, 0).strip()
        raise HeldError(int(text) if text.isdigit() else None) from None


def _is_at(path: Path, descriptor: int) -> bool:
    try:
        there = path.lstat()
    except OSError:
        return False
    return os.path.samestat(there, os.fstat(descriptor))
