"""The daemon's Unix socket: bound once, with group and mode set before anybody can connect, removed only if still ours.

Two daemons started at the same moment must not both win, and a file left by a killed daemon must not stop the next one.
So the check ("does anybody answer there?") and the bind happen under an ``flock`` on the directory itself, which leaves
no lock file behind and is released by the kernel whatever happens to us.
"""

from __future__ import annotations

import contextlib
import fcntl
import grp
import os
import socket
import stat
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from hapticd.config import paths

MAX_PATH_BYTES = 107
"""``sun_path`` holds 108 bytes, the last one a zero."""

BACKLOG = 128
PROBE_TIMEOUT_S = 1.0
LOCK_TIMEOUT_S = 5.0
"""Any user may lock a shared directory such as /tmp; that must not hang the daemon."""


class SocketError(Exception):
    """The control socket cannot be created; the text says where, why and what to do."""


@dataclass(frozen=True)
class BoundSocket:
    """A listening socket and the identity of the file that stands for it."""

    socket: socket.socket
    path: Path
    device: int
    inode: int

    def close(self) -> None:
        """Close the socket and remove its file, unless another daemon has put its own there since."""
        with contextlib.suppress(OSError), _directory_lock(self.path.parent):
            found = self.path.lstat()
            if (found.st_dev, found.st_ino) == (self.device, self.inode):
                self.path.unlink()
        self.socket.close()


def stop_path(path: Path) -> Path:
    """Where the stop channel of the daemon with this control socket lies."""
    return path.with_name(f"{path.name}.stop")


def bind(path: Path, mode: int = 0o660, group: str | None = None, kind: int = socket.SOCK_STREAM) -> BoundSocket:
    """Create the control socket and listen on it.

    Args:
        path: where; a missing directory is made with mode 0755, a stale socket file is replaced.
        mode: permission bits of the socket; who may write to it may command the motor.
        group: owning group by name or number, None for the process's own.

    Raises:
        SocketError: another daemon answers there, something else is in the way, or the system refuses.
    """
    path = path.absolute()
    if len(os.fsencode(path)) > MAX_PATH_BYTES:
        raise SocketError(
            f"socket path {path} is {len(os.fsencode(path))} bytes long; a Unix socket's path is at most "
            f"{MAX_PATH_BYTES} bytes: choose a shorter one with --socket or api.socket"
        )
    owner = group_id(group, "api.group") if group is not None else None
    try:
        path.parent.mkdir(mode=0o755, parents=True, exist_ok=True)
        if reason := paths.foreign(path.parent):
            raise SocketError(
                f"cannot create the control socket {path}: {reason}, or choose another socket with --socket"
            )
        with _directory_lock(path.parent):
            _make_room(path, kind)
            return _listen(path, mode, owner, kind)
    except FileExistsError as error:
        raise SocketError(f"cannot create the control socket {path}: {path.parent} is not a directory") from error
    except PermissionError as error:
        raise SocketError(f"cannot create the control socket {path}: {_permission(path, error)}") from error
    except OSError as error:
        raise SocketError(f"cannot create the control socket {path}: {error.strerror or error}") from error


def _permission(path: Path, error: PermissionError) -> str:
    """What was refused, and how to get it."""
    if path.parent.is_dir() and os.access(path.parent, os.W_OK):
        return str(error.strerror)
    what = "write to" if path.parent.is_dir() else "make"
    return (
        f"{error.strerror}: uid {os.geteuid()} may not {what} {path.parent}; choose another socket with --socket or "
        "api.socket, or start the service, whose folder systemd makes ('systemctl start hapticd')"
    )


@contextlib.contextmanager
def _directory_lock(directory: Path) -> Iterator[None]:
    descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        deadline = time.monotonic() + LOCK_TIMEOUT_S
        while True:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > deadline:
                    raise TimeoutError(None, f"another process keeps {directory} locked") from None
                time.sleep(0.01)
        yield
    finally:
        os.close(descriptor)


def _make_room(path: Path, kind: int) -> None:
    """Remove a stale socket; refuse a live one and anything that is no socket."""
    try:
        found = path.lstat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(found):
        raise SocketError(
            f"{path} exists and is not a socket: remove it, or choose another with --socket or api.socket"
        )
    if kind == socket.SOCK_STREAM and _answers(path):
        raise SocketError(
            f"another daemon answers on {path}: stop it first, or choose another socket with --socket or api.socket"
        )
    path.unlink()


def _answers(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.settimeout(PROBE_TIMEOUT_S)
        try:
            probe.connect(os.fspath(path))
        except (ConnectionRefusedError, FileNotFoundError):
            return False
        except (TimeoutError, BlockingIOError):
            return True  # somebody listens, with a full queue
    return True


def _listen(path: Path, mode: int, owner: int | None, kind: int) -> BoundSocket:
    server = socket.socket(socket.AF_UNIX, kind)
    made = False
    try:
        # Nobody can connect before listen(), so owner and mode are right from the first moment that matters, without
        # changing the umask, which belongs to the whole process and its other threads.
        server.bind(os.fspath(path))
        made = True
        if owner is not None:
            os.chown(path, -1, owner)
        path.chmod(mode)
        if kind == socket.SOCK_STREAM:
            server.listen(BACKLOG)
        found = path.lstat()
    except BaseException:
        if made:
            path.unlink(missing_ok=True)
        server.close()
        raise
    return BoundSocket(server, path, found.st_dev, found.st_ino)


def group_id(group: str | None, key: str) -> int:
    """Number of a group by name or number; None: the process's own.

    Args:
        group: the group.
        key: where it stands in the config, for messages.

    Raises:
        SocketError: there is none of that name.
    """
    if group is None:
        return os.getegid()
    if group.isdecimal():
        return int(group)
    try:
        return grp.getgrnam(group).gr_gid
    except KeyError:
        raise SocketError(f"{key} = {group!r}: no such group on this machine") from None
