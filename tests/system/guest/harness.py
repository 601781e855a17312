"""What the guest's checks stand on: a shell, the daemon's API, waiting, and the unit. Standard library only."""

from __future__ import annotations

import contextlib
import ctypes
import http.client
import json
import os
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

SOURCE = Path("/home/lab/hapticd")
SOCKET = "/run/hapticd/hapticd.sock"
CACHE = Path("/var/cache/hapticd")
PYTHON = "/opt/hapticd/bin/python"
DRIVE_LOG = Path("/root/drive.arrow")


def sh(command: str, timeout: float = 600.0, ok: tuple[int, ...] = (0,)) -> str:
    """Run a shell command and return its output; its exit code must be one of ``ok``."""
    done = subprocess.run(
        ["bash", "-c", command],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=timeout,
        check=False,
    )
    if done.returncode not in ok:
        raise AssertionError(f"{command!r} ended with {done.returncode}: {done.stdout[-600:]}")
    return done.stdout


class _Connection(http.client.HTTPConnection):
    def connect(self) -> None:
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(60.0)
        self.sock.connect(SOCKET)


def api(path: str, method: str = "GET") -> dict[str, Any]:
    """A request to the daemon, without the seconds that a Python program takes to start here."""
    connection = _Connection("hapticd")
    try:
        connection.request(method, path, "{}" if method == "POST" else None, {"Content-Type": "application/json"})
        reply = connection.getresponse()
        document = json.loads(reply.read())
    except (OSError, http.client.HTTPException) as error:
        raise AssertionError(f"{method} {path}: {error}") from error
    finally:
        connection.close()
    if reply.status != 200:
        raise AssertionError(f"{method} {path}: {document}")
    return dict(document)


def status() -> dict[str, Any]:
    return api("/status")


def until(condition: Callable[[], Any], what: str, timeout: float = 300.0) -> Any:
    """Poll until something is so, and return it."""
    deadline = time.monotonic() + timeout
    reason = ""
    while True:
        try:
            if found := condition():
                return found
        except (AssertionError, subprocess.TimeoutExpired) as error:
            reason = f"; {error}"
        if time.monotonic() > deadline:
            raise AssertionError(f"waited {timeout:g} s in vain for: {what}{reason}")
        time.sleep(0.5)


def unit(key: str, name: str = "hapticd") -> str:
    return sh(f"systemctl show {name} -p {key} --value").strip()


def until_active() -> None:
    until(lambda: unit("ActiveState") == "active", "the service to be active")


def journal(lines: int = 50) -> str:
    return sh(f"journalctl -u hapticd --no-pager -o cat -n {lines}")


def circumstances() -> str:
    """What the daemon says when a check has failed: its state, its fault and its last words."""
    try:
        found = status()
        return f"state {found['state']}, fault {found['fault']}, journal: {journal(8)}"
    except (AssertionError, subprocess.TimeoutExpired, KeyError) as error:
        return f"no status ({error}), journal: {journal(8)}"


def compiled() -> int:
    """How many functions the cache holds."""
    return sum(1 for _ in CACHE.rglob("*.nbi"))


def start() -> None:
    """Render the spring; a latched fault is cleared first."""
    if status()["state"] == "fault":
        api("/clear", "POST")
    api("/start", "POST")
    until(lambda: status()["state"] == "running", "the spring to be rendered", 30)


def drive_log(*expressions: str) -> list[str]:
    """What the drive wrote down: expressions of ``log``, a DeviceLog, as text."""
    script = (
        "from pathlib import Path; from statistics import median; from hapticd.hil.device_log import DeviceLog; "
        f"log = DeviceLog.read(Path('{DRIVE_LOG}')); print({', '.join(expressions)})"
    )
    return sh(f'{PYTHON} -c "{script}"').split()[-len(expressions) :]


def zero_current_after(struck_ns: int) -> float:
    """From an instant to the motor's last current, s, as the drive wrote it down; it must have flowed at that instant."""
    flowed, zero = drive_log(f"log.flows_at({struck_ns})", f"log.zero_current_after({struck_ns})")
    assert flowed == "True", "no current flowed before"
    assert zero != "None", "current flows on"
    return (int(zero) - struck_ns) * 1e-9


class HungThread:
    """One thread of a process stands still, and no other: a debugger's stop (ptrace(2), PTRACE_SEIZE, PTRACE_INTERRUPT)."""

    _SEIZE, _INTERRUPT, _DETACH = 0x4206, 0x4207, 17
    _WALL = 0x40000000

    def __init__(self, tid: int) -> None:
        self._tid = tid
        self._ptrace = ctypes.CDLL(None, use_errno=True).ptrace
        self._ptrace.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p]
        self._ptrace.restype = ctypes.c_long

    def __enter__(self) -> HungThread:
        for request in (self._SEIZE, self._INTERRUPT):
            if self._ptrace(request, self._tid, None, None) != 0:
                raise AssertionError(f"ptrace({request:#x}): {os.strerror(ctypes.get_errno())}")
        return self

    def bury(self) -> None:
        """Take notice of the thread's stop, or of its end: before that, nobody sees that its process has ended."""
        with contextlib.suppress(ChildProcessError):
            os.waitpid(self._tid, os.WNOHANG | self._WALL)

    def __exit__(self, *_: object) -> None:
        self.bury()
        self._ptrace(self._DETACH, self._tid, None, None)
