"""Client of the control API: sends requests for `Endpoints` to the daemon's socket, and helps to run experiments.

Each request opens a connection, which costs microseconds on a Unix socket; so no connection can become stale, and a client
may be used by several threads. A stop uses the stop channel first (`hapticd.client.stop_channel`).
"""

from __future__ import annotations

import contextlib
import http.client
import json
import os
import socket
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any, cast

from hapticd.client import stop_channel
from hapticd.config.paths import find_socket
from hapticd.control.endpoints import TEXT, Endpoint, Endpoints, JsonDict

ANSWER_TIMEOUT_S = 30.0
"""Longest wait for an answer [s]: opening a device or reading a config can take seconds, all else milliseconds."""
STOPPED_TIMEOUT_S = 5.0
"""The same after a successful stop, when only the report is missing [s]."""
DEADLINE, SENT = "Request-Deadline-Ns", "Request-Sent-Ns"
"""Headers of a command: its deadline, and the time of sending, as CLOCK_MONOTONIC in ns, which both sides share."""
_QUEUE_POLL_S = 0.01


class DaemonUnreachable(Exception):  # noqa: N818 - named as the public exit code is: "daemon not reachable"
    """No daemon answers on the socket, or not in time; the text says where, why, and what to do."""


class StoppedUnanswered(DaemonUnreachable):
    """A stop was executed, according to the stop channel, but the API did not answer; the text says both.

    Attributes:
        state: ``off`` or ``fault``, both at zero current.
    """

    def __init__(self, state: str, reason: str) -> None:
        super().__init__(f"{state}: zero current; the API did not answer: {reason}")
        self.state = state


class RequestRefused(Exception):  # noqa: N818 - an answer, not an error of the program
    """The daemon refused the request, or failed to execute it.

    Attributes:
        status: HTTP status: 409 refused in this state, 422 wrong request or config, 502 device failure.
        code: short stable name of the reason.
        message: sentence for the user.
        problems: one dict for each invalid setting, for code ``config``.
        choice: ``reason``, ``remedies``, ``help`` and ``force`` of a refusal with remedies; else empty.
    """

    def __init__(
        self,
        status: int,
        code: str,
        message: str,
        problems: list[dict[str, Any]] | None = None,
        choice: dict[str, Any] | None = None,
    ) -> None:
        super().__init__(message)
        self.choice = choice or {}
        self.status = status
        self.code = code
        self.message = message
        self.problems = problems or []


class Client(Endpoints):
    """Client of the daemon on one socket. Every method of `Endpoints` returns the daemon's JSON reply as a dict.

    Args:
        socket_path: the daemon's Unix socket. None: as the command line finds it: ``$HAPTICD_SOCKET``, the user's own
            daemon, the service.
        timeout_s: longest wait for an answer, s.

    Raises:
        DaemonUnreachable: from every method, if no daemon answers; from `stop` and `estop` its subclass `StoppedUnanswered`,
            if the current is zero and only the report is missing.
        RequestRefused: from every method, if the daemon refuses.
    """

    def __init__(self, socket_path: str | Path | None = None, timeout_s: float = ANSWER_TIMEOUT_S) -> None:
        self.socket_path = find_socket() if socket_path is None else Path(socket_path)
        self.timeout_s = timeout_s

    def wait(
        self, experiment: int, progress: Callable[[float], None] | None = None, interval_s: float = 0.1
    ) -> JsonDict:
        """Poll until an experiment is over, and return its last report.

        Args:
            experiment: the ``experiment`` of the reply that started it.
            progress: called with the fraction done, 0 to 1.
            interval_s: time between two polls, s.

        Raises:
            RequestRefused: code ``experiment_lost``, another experiment has begun since.
        """
        while True:
            report = self.experiment()
            if report["id"] != experiment:
                raise RequestRefused(
                    409, "experiment_lost", "another experiment has begun; this one is in its run file"
                )
            if progress is not None:
                progress(float(report["progress"]))
            if report["state"] != "running":
                return report
            time.sleep(interval_s)

    def send(self, endpoint: Endpoint, fields: JsonDict) -> Any:
        """Send a request to an endpoint and return its reply: a dict, or text."""
        if endpoint.queue in ("stop", "estop"):
            return self._halt(endpoint)
        return self._request(endpoint, fields, self.timeout_s)

    def _halt(self, endpoint: Endpoint) -> Any:
        """A stop: the stop channel first, then the request for the full answer."""
        state = stop_channel.ask(self.socket_path, cast(stop_channel.Word, endpoint.queue))
        obeyed = state in ("off", "fault")
        try:
            return self._request(endpoint, {}, min(self.timeout_s, STOPPED_TIMEOUT_S) if obeyed else self.timeout_s)
        except DaemonUnreachable as error:
            if state is None and isinstance(error, _NotAsked):
                raise
            if state is not None and obeyed:
                raise StoppedUnanswered(state, str(error)) from error
            late = state == stop_channel.LATE
            told = "the servo loop does not obey" if late else "the stop channel does not answer either"
            raise DaemonUnreachable(f"{error}; {told}: to be sure, cut the power of the amplifier") from error

    def _request(self, endpoint: Endpoint, fields: JsonDict, timeout_s: float) -> Any:
        headers = {"Content-Type": "application/json", "Connection": "close"}
        if endpoint.method == "POST":
            now_ns = time.monotonic_ns()
            headers[SENT], headers[DEADLINE] = str(now_ns), str(now_ns + round(timeout_s * 1e9))
        body = json.dumps(fields, allow_nan=False, default=os.fspath) if endpoint.signature.parameters else None
        connection = _UnixConnection(self.socket_path, timeout_s)
        try:
            connection.connect()
        except OSError as error:
            raise self._unreachable(error, timeout_s) from error
        try:
            # If the daemon refuses the connection, it sends the reason without reading the request.
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                connection.request(endpoint.method, endpoint.path, body, headers)
            reply = connection.getresponse()
            if endpoint.reply == TEXT and reply.status == 200:
                return reply.read().decode()
            return self._answer(reply.status, reply.read())
        except TimeoutError as error:
            message = f"the daemon on {self.socket_path} accepts requests and does not answer; look at its log"
            raise DaemonUnreachable(message) from error
        except (OSError, http.client.HTTPException) as error:
            raise DaemonUnreachable(
                f"the daemon on {self.socket_path} closed the connection without an answer"
            ) from error
        finally:
            connection.close()

    def _answer(self, status: int, content: bytes) -> JsonDict:
        try:
            answer = json.loads(content)
        except ValueError:
            answer = None
        if not isinstance(answer, dict) or (status != 200 and "error" not in answer):
            raise DaemonUnreachable(f"what answers on {self.socket_path} is not hapticd (HTTP {status})")
        if status != 200:
            error = answer["error"]
            choice = {name: error[name] for name in ("reason", "remedies", "help", "force") if name in error}
            raise RequestRefused(status, error["code"], error["message"], error.get("problems"), choice)
        return answer

    def _unreachable(self, error: OSError, timeout_s: float) -> DaemonUnreachable:
        """The error for a failed connection, with its reason."""
        path = self.socket_path
        if isinstance(error, FileNotFoundError):
            return _NotAsked(f"no daemon answers on {path}; start one with 'hapticd run'")
        if isinstance(error, ConnectionRefusedError):
            left = "is left from one that has ended" if path.is_socket() else "is not a socket"
            return _NotAsked(f"no daemon answers on {path}, which {left}; start one with 'hapticd run'")
        if isinstance(error, PermissionError):
            owner = "one of its folders may not be entered"
            with contextlib.suppress(OSError):
                found = path.stat()
                owner = f"owner {found.st_uid}, group {found.st_gid}, mode {found.st_mode & 0o777:04o}"
            return _NotAsked(f"no permission to use the daemon on {path} ({owner}); ask to be added to its group")
        if isinstance(error, BlockingIOError | TimeoutError):
            return DaemonUnreachable(
                f"the daemon on {path} runs but has accepted no connection for {timeout_s:g} s: it hangs, or is overloaded"
            )
        return DaemonUnreachable(f"cannot connect to the daemon on {path}: {error.strerror or error}")


class _NotAsked(DaemonUnreachable):
    """No daemon on this socket, or no permission to use it."""


@contextmanager
def settings_for_a_while(client: Client, settings: Mapping[str, Any], force: bool = False) -> Iterator[None]:
    """Apply live settings, and restore the previous ones at the end, also after an error.

    Args:
        client: of the daemon.
        settings: dotted key to value; if empty, no request is sent.
        force: override the stability guard, which never prevents the restoration.

    Raises:
        RequestRefused: the daemon refuses them; then none is applied.
    """
    if not settings:
        yield
        return
    config = client.config()
    before = {key: reduce(getitem, key.split("."), config) for key in settings}
    client.set(dict(settings), force)
    try:
        yield
    finally:
        client.set(before, force=True)


@contextmanager
def stop_on_interrupt(client: Client, say: Callable[[str], None]) -> Iterator[None]:
    """Send a stop to the daemon on an interrupt, because Ctrl-C must also stop a moving shaft."""
    try:
        yield
    except KeyboardInterrupt:
        try:
            client.stop()
            say("a stop was sent to the daemon")
        except StoppedUnanswered as stopped:
            say(str(stopped))
        raise


class _UnixConnection(http.client.HTTPConnection):
    """HTTP over a Unix socket."""

    def __init__(self, path: Path, timeout_s: float) -> None:
        super().__init__("hapticd", timeout=timeout_s)
        self.path, self._timeout_s = path, timeout_s

    def connect(self) -> None:
        """Connect to the socket file instead of a host.

        Raises:
            BlockingIOError: the daemon's queue of connections is full.
        """
        deadline = time.monotonic() + self._timeout_s
        while True:
            self.sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                self.sock.settimeout(self._timeout_s)
                self.sock.connect(os.fspath(self.path))
                return
            except BlockingIOError:  # connect() does not wait for a place in the queue of a Unix socket
                self.sock.close()
                if time.monotonic() > deadline:
                    raise
            except BaseException:
                self.sock.close()
                raise
            time.sleep(_QUEUE_POLL_S)
