"""The daemon's Unix sockets: group and mode are set before any connection, and a file is removed only if it is our own.

Two daemons must not use the same path, and the file of a killed daemon must not prevent the next start. So the check
whether a daemon answers on either socket, and the bind, are done with the daemon's lock (`hapticd.service._lock`), which is
held as long as the control socket. A socket that was removed is bound again (`BoundSocket.rebind`, called by
`hapticd.service.self_check`), unless another daemon answers there.
"""

from __future__ import annotations

import contextlib
import errno
import grp
import logging
import os
import socket
import stat
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from hapticd.config import paths
from hapticd.service._lock import DaemonLock, HeldError

MAX_PATH_BYTES = 107
"""``sun_path`` has 108 bytes, including the final zero."""

BACKLOG = 128
PROBE_TIMEOUT_S = 1.0
_CHANGE_S = 2.0
"""Longest wait of `BoundSocket.close` for a hanging `BoundSocket.rebind` [s]."""

log = logging.getLogger(__name__)


class SocketError(Exception):
    """The control socket cannot be created; the text says where, why and what to do."""


class TakenError(SocketError):
    """Another daemon answers there."""


@dataclass(frozen=True)
class Claim:
    """The exclusive right to a socket path.

    Attributes:
        lock: of the daemon; None if it cannot be created, which has been logged.
    """

    lock: DaemonLock | None

    def release(self) -> None:
        """Release it. Safe to call twice, and after the bound socket with the lock is closed."""
        if self.lock is not None:
            self.lock.release()


class BoundSocket:
    """A socket and its file.

    Attributes:
        path: of the file.
        socket: the socket; a stream socket is replaced by `rebind`.
        lock: the daemon's lock, released with the socket; None for none.
    """

    def __init__(self, path: Path, mode: int, owner: int | None, kind: int, lock: DaemonLock | None) -> None:
        self.path, self.lock = path, lock
        self._mode, self._owner, self._kind = mode, owner, kind
        self._changing = threading.Lock()
        self._closed = False
        self.socket, self._file = _listen(path, mode, owner, kind)

    def intact(self) -> bool:
        """Whether the file at the path is our own. While the socket is open, its inode is not reused."""
        try:
            return os.path.samestat(self.path.lstat(), self._file)
        except OSError:
            return False

    def rebind(self) -> socket.socket:
        """Bind to the path again, and create the folder if needed.

        Returns:
            The listening socket. A datagram socket keeps its object and descriptor, so that a waiting thread continues. A
            stream socket is a new one; the caller closes the old one.

        Raises:
            TakenError: another daemon answers there.
            SocketError: the path exists and is no socket, the system refuses, or the socket is closed.
        """
        with self._changing, _as_socket_error(self.path):
            if self._closed:
                raise SocketError(f"{self.path} is closed")
            _prepare(self.path, self._kind)
            new, self._file = _listen(self.path, self._mode, self._owner, self._kind)
            if self._kind == socket.SOCK_STREAM:
                self.socket = new
            else:
                with new:
                    os.dup2(new.fileno(), self.socket.fileno(), inheritable=False)
            return self.socket

    def close(self) -> None:
        """Close the socket, remove its file if it is still our own, and release the lock."""
        free = self._changing.acquire(timeout=_CHANGE_S)
        self._closed = True
        try:
            with contextlib.suppress(OSError):
                if self.intact():
                    self.path.unlink()
            self.socket.close()
            if self.lock is not None:
                self.lock.release()
        finally:
            if free:
                self._changing.release()


def stop_path(path: Path) -> Path:
    """Path of the stop channel that belongs to a control socket."""
    return path.with_name(f"{path.name}.stop")


def claim(path: Path) -> Claim:
    """Claim a socket path and its stop channel, before the device is opened and the sockets are bound.

    Returns:
        The claim, for `bind`.

    Raises:
        SocketError: another daemon runs there, the path exists and is no socket, or the system refuses.
    """
    path = _short(path)
    claimed = Claim(_take_lock(path))
    try:
        for each, kind in ((path, socket.SOCK_STREAM), (_short(stop_path(path)), socket.SOCK_DGRAM)):
            with _as_socket_error(each):
                _prepare(each, kind)
    except BaseException:
        claimed.release()
        raise
    return claimed


def _short(path: Path) -> Path:
    path = path.absolute()
    if len(os.fsencode(path)) > MAX_PATH_BYTES:
        raise SocketError(
            f"socket path {path} is {len(os.fsencode(path))} bytes long; a Unix socket's path is at most "
            f"{MAX_PATH_BYTES} bytes: choose a shorter one with --socket or api.socket"
        )
    return path


def bind(
    path: Path,
    mode: int = 0o660,
    group: str | None = None,
    kind: int = socket.SOCK_STREAM,
    claimed: Claim | None = None,
) -> BoundSocket:
    """Create a socket of the daemon; for a stream socket, also listen on it and hold the daemon's lock.

    Args:
        path: of the socket; a missing folder is created with mode 0755, a stale socket file is replaced.
        mode: permission bits of the socket; who may write to it may command the motor.
        group: owning group by name or number, None for the process's own.
        kind: ``SOCK_STREAM`` for the control socket; ``SOCK_DGRAM`` for the stop channel of the same daemon.
        claimed: from `claim`, released with the socket; None: a control socket is claimed here.

    Raises:
        SocketError: another daemon runs there, the path exists and is no socket, or the system refuses.
    """
    path = _short(path)
    owner = group_id(group, "api.group") if group is not None else None
    if claimed is None:
        claimed = Claim(_take_lock(path) if kind == socket.SOCK_STREAM else None)
    try:
        with _as_socket_error(path):
            _prepare(path, kind)
            return BoundSocket(path, mode, owner, kind, claimed.lock)
    except BaseException:
        claimed.release()
        raise


def _take_lock(path: Path) -> DaemonLock | None:
    """The daemon's lock; None, with a warning in the log, if it cannot be created."""
    try:
        return DaemonLock.take(path)
    except HeldError as held:
        who = f"another daemon (process {held.pid})" if held.pid else "another daemon"
        raise SocketError(
            f"{who} runs on {path}: stop it first, or choose another socket with --socket or api.socket"
        ) from None
    except OSError as error:
        log.warning(
            "no lock against a second daemon on %s (%s: %s): it is found only while it answers there",
            path,
            error.filename or "state directory",
            error.strerror or error,
        )
        return None


def _prepare(path: Path, kind: int) -> None:
    """Create the folder, and remove a stale socket in it."""
    path.parent.mkdir(mode=0o755, parents=True, exist_ok=True)
    if reason := paths.foreign(path.parent):
        raise SocketError(f"cannot create the control socket {path}: {reason}, or choose another socket with --socket")
    _make_room(path, kind)


@contextlib.contextmanager
def _as_socket_error(path: Path) -> Iterator[None]:
    try:
        yield
    except FileExistsError as error:
        raise SocketError(f"cannot create the control socket {path}: {path.parent} is not a directory") from error
    except PermissionError as error:
        raise SocketError(f"cannot create the control socket {path}: {_permission(path, error)}") from error
    except OSError as error:
        raise SocketError(f"cannot create the control socket {path}: {error.strerror or error}") from error


def _permission(path: Path, error: PermissionError) -> str:
    """What was refused, and the remedy."""
    if path.parent.is_dir() and os.access(path.parent, os.W_OK):
        return str(error.strerror)
    what = "write to" if path.parent.is_dir() else "make"
    return (
        f"{error.strerror}: uid {os.geteuid()} may not {what} {path.parent}; choose another socket with --socket or "
        "api.socket, or start the service, whose folder systemd makes ('systemctl start hapticd')"
    )


def _make_room(path: Path, kind: int) -> None:
    """Remove a stale socket; refuse a live one, and a file that is not a socket."""
    try:
        found = path.lstat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(found):
        raise SocketError(
            f"{path} exists and is not a socket: remove it, or choose another with --socket or api.socket"
        )
    if _answers(path, kind):
        raise TakenError(
            f"another daemon answers on {path}: stop it first, or choose another socket with --socket or api.socket"
        )
    path.unlink()


def _answers(path: Path, kind: int) -> bool:
    """Whether a process has this socket open. A datagram socket does not receive anything from this check."""
    with socket.socket(socket.AF_UNIX, kind) as probe:
        probe.settimeout(PROBE_TIMEOUT_S)
        try:
            probe.connect(os.fspath(path))
        except (ConnectionRefusedError, FileNotFoundError):
            return False
        except (TimeoutError, BlockingIOError):
            return True  # a process listens, with a full queue
        except OSError as error:
            if error.errno == errno.EPROTOTYPE:
                return True  # a process has a socket of the other kind
            raise
    return True


def _listen(path: Path, mode: int, owner: int | None, kind: int) -> tuple[socket.socket, os.stat_result]:
    """The socket and its file."""
    server = socket.socket(socket.AF_UNIX, kind)
    made = False
    try:
        # Before listen() nobody can connect, so owner and mode may be set after bind(). The umask is not changed, because
        # it belongs to the whole process.
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
    return server, found


def group_id(group: str | None, key: str) -> int:
    """Number of a group by name or number; None: the process's own.

    Args:
        group: the group.
        key: its config key, for messages.

    Raises:
        SocketError: the group does not exist.
    """
    if group is None:
        return os.getegid()
    if group.isdecimal():
        return int(group)
    try:
        return grp.getgrnam(group).gr_gid
    except KeyError:
        raise SocketError(f"{key} = {group!r}: no such group on this machine") from None
