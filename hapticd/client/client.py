"""Client of the control API: sends `Endpoints` to the daemon's socket, and helps to run experiments.

Each request is a connection of its own: on a Unix socket that costs microseconds, nothing goes stale while nobody asks,
and one client may be used from several threads.
"""

from __future__ import annotations

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
from typing import Any

from hapticd.config.paths import find_socket
from hapticd.control.endpoints import TEXT, Endpoint, Endpoints, JsonDict

ANSWER_TIMEOUT_S = 30.0
"""Opening a device or reading a new config can take seconds; everything else is answered in milliseconds."""


class DaemonUnreachable(Exception):  # noqa: N818 - named as the public exit code is: "daemon not reachable"
    """Nobody answers on the socket, or not in time; the text says where and how to start a daemon."""


class RequestRefused(Exception):  # noqa: N818 - an answer, not an error of the program
    """The daemon answered, and not with yes.

    Attributes:
        status: HTTP status: 409 refused in this state, 422 wrong request or config, 502 device failure.
        code: short stable name of the reason.
        message: sentence for people.
        problems: one dict for each wrong setting, for code ``config``.
    """

    def __init__(self, status: int, code: str, message: str, problems: list[dict[str, Any]] | None = None) -> None:
        super().__init__(message)
        self.status = status
        self.code = code
        self.message = message
        self.problems = problems or []


class Client(Endpoints):
    """Talks to the daemon on one socket. Every method of `Endpoints` returns the daemon's JSON reply as a dict.

    Args:
        socket_path: the daemon's Unix socket. None looks for it as the command line does: ``$HAPTICD_SOCKET``, the user's
            own daemon, the service.
        timeout_s: how long to wait for an answer, s.

    Raises:
        DaemonUnreachable: from every method, when nobody answers.
        RequestRefused: from every method, when the daemon says no.
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
        """Ask for an endpoint and return its reply: a dict, or text."""
        body = json.dumps(fields, allow_nan=False, default=os.fspath) if endpoint.signature.parameters else None
        connection = _UnixConnection(self.socket_path, self.timeout_s)
        try:
            connection.connect()
        except OSError as error:
            raise DaemonUnreachable(self._why_unreachable()) from error
        try:
            connection.request(
                endpoint.method, endpoint.path, body, {"Content-Type": "application/json", "Connection": "close"}
            )
            reply = connection.getresponse()
            if endpoint.reply == TEXT and reply.status == 200:
                return reply.read().decode()
            return self._answer(reply.status, reply.read())
        except TimeoutError as error:
            message = f"the daemon on {self.socket_path} accepts requests and does not answer; look at its log"
            raise DaemonUnreachable(message) from error
        except (OSError, http.client.HTTPException) as error:
            raise DaemonUnreachable(f"the daemon on {self.socket_path} went away without answering") from error
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
            raise RequestRefused(status, error["code"], error["message"], error.get("problems"))
        return answer

    def _why_unreachable(self) -> str:
        path = self.socket_path
        if path.is_socket() and not os.access(path, os.W_OK):
            found = path.stat()
            owner = f"owner {found.st_uid}, group {found.st_gid}, mode {found.st_mode & 0o777:04o}"
            return f"no permission to talk to the daemon on {path} ({owner}); ask to be taken into its group"
        return f"no daemon answers on {path}; start one with 'hapticd run'"


@contextmanager
def settings_for_a_while(client: Client, settings: Mapping[str, Any], force: bool = False) -> Iterator[None]:
    """Apply live settings, and take them back at the end, however it comes.

    Args:
        client: the daemon.
        settings: dotted key to value; nothing is asked of the daemon where there is none.
        force: override the stability guard. What was in force before comes back in any case.

    Raises:
        RequestRefused: the daemon does not take them; none is in force then.
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
    """Stop the daemon when interrupted: whoever presses Ctrl-C at a moving shaft wants it to stand still."""
    try:
        yield
    except KeyboardInterrupt:
        client.stop()
        say("the daemon was told to stop")
        raise


class _UnixConnection(http.client.HTTPConnection):
    """HTTP over a Unix socket."""

    def __init__(self, path: Path, timeout_s: float) -> None:
        super().__init__("hapticd", timeout=timeout_s)
        self.path = path

    def connect(self) -> None:
        """Connect to the socket file instead of a host."""
        self.sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self.sock.settimeout(self.timeout)
            self.sock.connect(os.fspath(self.path))
        except BaseException:
            self.sock.close()
            raise
