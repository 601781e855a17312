"""One method for each endpoint of the control API, and waiting for an experiment.

Each request is a connection of its own: on a Unix socket that costs microseconds, nothing goes stale while nobody asks,
and one client may be used from several threads.
"""

from __future__ import annotations

import http.client
import json
import os
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hapticd.client.errors import DaemonUnreachable, RequestRefused
from hapticd.config.places import find_socket

JsonDict = dict[str, Any]

ANSWER_TIMEOUT_S = 30.0
"""Opening a device or reading a new config can take seconds; everything else is answered in milliseconds."""


class Client:
    """Talks to the daemon on one socket. Every method returns the daemon's JSON reply as a dict.

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

    def status(self) -> JsonDict:
        """State, fault, timing, operating point, position and recorder."""
        return self._request("GET", "/status")

    def config(self) -> JsonDict:
        """The config in force."""
        return self._request("GET", "/config")

    def metrics(self) -> str:
        """The daemon's numbers in Prometheus' text format."""
        connection = _UnixConnection(self.socket_path, self.timeout_s)
        try:
            connection.request("GET", "/metrics")
            return connection.getresponse().read().decode()
        except (OSError, http.client.HTTPException) as error:
            raise DaemonUnreachable(self._why_unreachable()) from error
        finally:
            connection.close()

    def start(self, force: bool = False) -> JsonDict:
        """Enable the amplifier and render the spring; `force`, here and below, overrides the stability guard."""
        return self._request("POST", "/start", _given(force=force or None))

    def stop(self) -> JsonDict:
        """Zero current, then disable."""
        return self._request("POST", "/stop")

    def estop(self) -> JsonDict:
        """Zero current at once, disable, latch a fault."""
        return self._request("POST", "/estop")

    def clear(self) -> JsonDict:
        """Clear a latched fault."""
        return self._request("POST", "/clear")

    def set(self, settings: dict[str, Any], force: bool = False) -> JsonDict:
        """Change live settings: dotted key to value, a string being read as a YAML scalar."""
        return self._request("POST", "/set", _given(settings=settings, force=force or None))

    def release(self, deflection: float, duration_s: float | None = None, force: bool = False) -> JsonDict:
        """Start the Fig. 8 experiment at a deflection in coarse ticks; see :meth:`wait`."""
        body = _given(deflection=deflection, duration_s=duration_s, force=force or None)
        return self._request("POST", "/release", body)

    def excite(
        self,
        name: str = "all",
        amplitude: float | None = None,
        duration_s: float | None = None,
        force: bool = False,
        **plan: float | None,
    ) -> JsonDict:
        """Start an identification experiment; see :meth:`wait`.

        Args:
            name: which; ``all`` of them by default.
            amplitude: peak in A, or rad or m for shapes that move the spring's origin.
            duration_s: duration in s.
            force: as in :meth:`start`.
            plan: ``low_hz``, ``high_hz`` (of a chirp) and ``seed`` (of steps).
        """
        body = _given(name=name, amplitude=amplitude, duration_s=duration_s, force=force or None, **plan)
        return self._request("POST", "/excite", body)

    def experiment(self) -> JsonDict:
        """The newest experiment and how far it is."""
        return self._request("GET", "/experiment")

    def record_start(self, path: str | Path | None = None) -> JsonDict:
        """Start recording, to an absolute path or to a new file in ``record.directory``."""
        return self._request("POST", "/record/start", _given(path=None if path is None else os.fspath(path)))

    def record_stop(self) -> JsonDict:
        """Stop recording and close the file."""
        return self._request("POST", "/record/stop")

    def reload(self, path: str | Path | None = None, force: bool = False) -> JsonDict:
        """Read the config anew."""
        body = _given(path=None if path is None else os.fspath(path), force=force or None)
        return self._request("POST", "/reload", body)

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

    def _request(self, method: str, path: str, body: JsonDict | None = None) -> JsonDict:
        text = None if body is None else json.dumps(body, allow_nan=False)
        connection = _UnixConnection(self.socket_path, self.timeout_s)
        try:
            connection.connect()
        except OSError as error:
            raise DaemonUnreachable(self._why_unreachable()) from error
        try:
            connection.request(method, path, text, {"Content-Type": "application/json", "Connection": "close"})
            reply = connection.getresponse()
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


def _given(**fields: Any) -> JsonDict:
    return {name: value for name, value in fields.items() if value is not None}
