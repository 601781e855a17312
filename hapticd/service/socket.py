"""The daemon's Unix sockets: bound once, with group and mode set before anybody can connect, removed only if still ours.

Two daemons on one path must not both win, and a file left by a killed daemon must not stop the next one. So "does anybody
answer there?", asked of both sockets, and the bind happen under the daemon's lock (`hapticd.service.lock`), which is held
for as long as the control socket is. What is removed while the daemon runs is bound anew (`BoundSocket.rebind`;
`hapticd.service.self_check` looks), unless another daemon answers there by then.
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
from hapticd.service.lock import DaemonLock, HeldError

MAX_PATH_BYTES = 107
"""``sun_path`` holds 108 bytes, the last one a zero."""

BACKLOG = 128
PROBE_TIMEOUT_S = 1.0
_CHANGE_S = 2.0
"""Longest wait of an end for a file system that hangs under `BoundSocket.rebind`."""

log = logging.getLogger(__name__)


class SocketError(Exception):
    """The control socket cannot be created; the text says where, why and what to do."""


class TakenError(SocketError):
    """Another daemon answers there."""


@dataclass(frozen=True)
class Claim:
    """The right to be the one daemon for a socket path.

    Attributes:
        lock: of the daemon; None where there can be none, which has been said.
    """

    lock: DaemonLock | None

    def release(self) -> None:
        """Let go. Safe to call twice, and where the bound socket that has the lock is closed."""
        if self.lock is not None:
            self.lock.release()


class BoundSocket:
    """A socket and the file that stands for it.

    Attributes:
        path: the file.
        socket: the socket; of a stream, another one after `rebind`.
        lock: the daemon's lock, released with the socket; None where there is none.
    """

    def __init__(self, path: Path, mode: int, owner: int | None, kind: int, lock: DaemonLock | None) -> None:
        self.path, self.lock = path, lock
        self._mode, self._owner, self._kind = mode, owner, kind
        self._changing = threading.Lock()
        self._closed = False
        self.socket, self._file = _listen(path, mode, owner, kind)

    def intact(self) -> bool:
        """Whether the file at the path is ours. While the socket is open its inode is not used again."""
        try:
            return os.path.samestat(self.path.lstat(), self._file)
        except OSError:
            return False

    def rebind(self) -> socket.socket:
        """Bind anew in the place, the folder made again.

        Returns:
            The socket that listens from now on. Of datagrams it is the same object with the same descriptor, so that who
            waits on the number goes on. Of a stream it is another one; who accepted on the old one closes that.

        Raises:
            TakenError: another daemon answers there.
            SocketError: something else is in the way, or the system refuses; or it is closed.
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
        """Close the socket and remove its file, unless another has been put there since; then let go of the lock."""
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
    """Where the stop channel of the daemon with this control socket lies."""
    return path.with_name(f"{path.name}.stop")


def claim(path: Path) -> Claim:
    """Be the one daemon for this socket and its stop channel, before the device is opened and the sockets bound.

    Returns:
        What `bind` needs.

    Raises:
        SocketError: another daemon is there, something else is in the way, or the system refuses.
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
    """Create a socket of the daemon's and, of a stream, listen on it and hold the daemon's lock.

    Args:
        path: where; a missing directory is made with mode 0755, a stale socket file is replaced.
        mode: permission bits of the socket; who may write to it may command the motor.
        group: owning group by name or number, None for the process's own.
        kind: ``SOCK_STREAM`` for the control socket; ``SOCK_DGRAM`` for one beside it, of the daemon that has that.
        claimed: by `claim`, released with the socket; None: a control socket is claimed here.

    Raises:
        SocketError: another daemon is there, something else is in the way, or the system refuses.
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
    """The daemon's lock; None, and a word about it, where there can be none."""
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
    """Make the folder, and room in it."""
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
    """What was refused, and how to get it."""
    if path.parent.is_dir() and os.access(path.parent, os.W_OK):
        return str(error.strerror)
    what = "write to" if path.parent.is_dir() else "make"
    return (
        f"{error.strerror}: uid {os.geteuid()} may not {what} {path.parent}; choose another socket with --socket or "
        "api.socket, or start the service, whose folder systemd makes ('systemctl start hapticd')"
    )


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
    if _answers(path, kind):
        raise TakenError(
            f"another daemon answers on {path}: stop it first, or choose another socket with --socket or api.socket"
        )
    path.unlink()


def _answers(path: Path, kind: int) -> bool:
    """Whether somebody has a socket open there. One of datagrams is told nothing by this."""
    with socket.socket(socket.AF_UNIX, kind) as probe:
        probe.settimeout(PROBE_TIMEOUT_S)
        try:
            probe.connect(os.fspath(path))
        except (ConnectionRefusedError, FileNotFoundError):
            return False
        except (TimeoutError, BlockingIOError):
            return True  # somebody listens, with a full queue
        except OSError as error:
            if error.errno == errno.EPROTOTYPE:
                return True  # somebody, of the other kind
            raise
    return True


def _listen(path: Path, mode: int, owner: int | None, kind: int) -> tuple[socket.socket, os.stat_result]:
    """The socket and its file."""
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
    return server, found


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
