"""From the command ``estop`` to zero current, by the stop channel, while all else of the daemon is in its worst state.

Each condition: the API under a flood of queries; its event loop frozen, and the daemon's lock held; no descriptor and no
thread to be had. The command is sent at a random phase of the period by a process of its own; zero current is the end of the
tick that wrote it, from the loop's own rows. Who reads the channel when the API's thread is frozen: a compiled listener with
a thread of its own, which needs neither the GIL nor that thread. The peer, ``cyclictest``, runs calm and under that flood.
"""

from __future__ import annotations

import contextlib
import os
import random
import resource
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from socket import AF_UNIX, SOCK_DGRAM, socket
from typing import Any

import numpy as np

from benchmarks import cyclictest
from benchmarks.hammer import Hammer
from benchmarks.report import BenchmarkError, Figure, progress
from hapticd.config import parse_config
from hapticd.service.api import ApiServer
from hapticd.service.daemon import Daemon
from hapticd.service.latch import FaultLatch
from hapticd.service.socket import bind, stop_path
from hapticd.servo import atomics, authority, layout

PERIOD_NS = 1_000_000
PRIORITY = 80
COUNT = 1000
CYCLICTEST_S = 20
CONFIG = {
    "plant": {
        "coulomb": 0.5
    },  # the shaft stands where it is, off the origin, so that the spring always asks for a current
    "spring": {"origin": 1.0},
    "safety": {"guard": "off", "soft_start_s": 0.0, "heartbeat_timeout_s": 10},
    "servo": {"priority": PRIORITY, "overrun": {"fault_after": None}},
    "record": {"enabled": False},
}
SENDER = """
import os, socket, sys, time
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(70))
except OSError:
    pass
channel = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
channel.connect(sys.argv[1])
for line in sys.stdin:
    time.sleep(float(line))
    now = time.monotonic_ns()
    channel.send(b"estop")
    print(now, flush=True)
"""


class Rig:
    """A daemon in this process, its API, its stop channel, and a process that sends."""

    def __init__(self, folder: Path) -> None:
        os.environ["XDG_STATE_HOME"] = str(folder / "state")
        self.path = folder / "h.sock"
        self.daemon = Daemon(parse_config(CONFIG, "estop"), None, FaultLatch(self.path))
        self.server = ApiServer(self.daemon, bind(self.path))
        self.channel = bind(stop_path(self.path), kind=SOCK_DGRAM)
        self.daemon.stop_channel.listen(self.channel.socket)
        self.server.start()
        command = [sys.executable, "-c", SENDER, str(stop_path(self.path))]
        self.sender = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def close(self) -> None:
        """End all of it."""
        self.sender.communicate()
        self.daemon.disable()
        self.server.stop()
        self.daemon.shutdown()
        self.channel.close()

    def latency_ns(self) -> float:
        """Of one estop: from the command to the end of the tick that wrote zero."""
        core = self.daemon.rig.core
        words = self.daemon.authority.words
        command = self.daemon.authority.arrived(60.0)
        self.daemon.rig.run(command)
        if not self.daemon.rig.wait(lambda: self.daemon.status()["current"] != 0.0, 5.0):
            raise BenchmarkError("the spring asks for no current")
        assert self.sender.stdin is not None
        assert self.sender.stdout is not None
        before = int(words[authority.ESTOPS])
        self.sender.stdin.write(f"{random.uniform(0.0, 0.003)}\n")
        self.sender.stdin.flush()
        sent_ns = int(self.sender.stdout.readline())
        if not self.daemon.rig.wait(lambda: core.load(atomics.FAULT_CODE) != 0 and self.daemon.rig.wait_ticks(2), 5.0):
            raise BenchmarkError("the loop does not obey")
        assert int(words[authority.ESTOPS]) == before + 1
        rows = core.history(1.0)
        start_ns = int(core.memory[0]["state"]["start_ns"])
        ends_ns = start_ns + rows["time_s"] * 1e9 + rows["wake_late_ns"] + rows["exec_ns"]
        zero = np.flatnonzero((ends_ns >= sent_ns) & (rows["current_command_A"] == 0.0))
        self.daemon.rig.clear(self.daemon.authority.arrived(60.0))
        self.daemon.rig.wait(lambda: core.load(atomics.MODE) == layout.OFF, 5.0)
        return float(ends_ns[zero[0]] - sent_ns)


@contextmanager
def calm(_: Rig) -> Iterator[None]:
    """Nothing else happens."""
    yield


@contextmanager
def flooded(rig: Rig) -> Iterator[None]:
    """Two processes of eight threads ask for the status as fast as they are answered."""
    with Hammer(rig.path, 2, 8):
        yield


@contextmanager
def frozen(rig: Rig) -> Iterator[None]:
    """The event loop does not come back from a request, and a command holds the daemon's lock."""
    ending = threading.Event()
    halt = rig.daemon.halt
    rig.daemon.halt = lambda name: (ending.wait(600.0), halt(name))[1]  # type: ignore[method-assign]
    locked = threading.Thread(target=_hold, args=(rig.daemon, ending))
    locked.start()
    with contextlib.closing(socket(AF_UNIX)) as hanging:
        hanging.connect(str(rig.path))
        hanging.sendall(b"POST /stop HTTP/1.1\r\nHost: h\r\nContent-Length: 0\r\n\r\n")
        try:
            yield
        finally:
            ending.set()
            locked.join()
    rig.daemon.halt = halt  # type: ignore[method-assign]


def _hold(daemon: Daemon, ending: threading.Event) -> None:
    with daemon._lock:
        ending.wait(600.0)


@contextmanager
def exhausted(rig: Rig) -> Iterator[None]:
    """No descriptor can be opened and no thread made."""

    def refuse(_: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    start: Any = threading.Thread.start
    resource.setrlimit(resource.RLIMIT_NOFILE, (3, hard))
    threading.Thread.start = refuse  # type: ignore[method-assign,assignment]
    try:
        yield
    finally:
        threading.Thread.start = start  # type: ignore[method-assign]
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


CONDITIONS: dict[str, Callable[[Rig], Any]] = {
    "calm": calm,
    "flood of the API": flooded,
    "API frozen, lock held": frozen,
    "no descriptor, no thread": exhausted,
}


def measure(quick: bool) -> list[Figure]:
    """The worst estop under each condition, beside two periods and cyclictest's worst."""
    cyclictest.require()
    count, seconds = (10, 2) if quick else (COUNT, CYCLICTEST_S)
    found: dict[str, list[float]] = {}
    worst_ns: dict[str, float] = {}
    with tempfile.TemporaryDirectory(prefix="hapticd-estop-") as folder:
        rig = Rig(Path(folder))
        try:
            for name, condition in CONDITIONS.items():
                with condition(rig):
                    found[name] = [rig.latency_ns() for _ in range(count)]
                    if condition in (calm, flooded):  # the others load no processor
                        worst_ns[name] = float(cyclictest.lateness_ns(seconds, PERIOD_NS, PRIORITY)[-1])
                progress(f"{name}: worst {max(found[name]) / 1e6:.3f} ms of {count}")
        finally:
            rig.close()
    return [
        Figure(
            f"estop to zero current, {name}: worst of {count}",
            max(latencies) / 1e6,
            "ms",
            (2 * PERIOD_NS + worst_ns.get(name, worst_ns["calm"])) / 1e6,
            peer="2 periods + cyclictest's worst",
            details={
                "median_ms": float(np.median(latencies)) / 1e6,
                "cyclictest_worst_ms": {condition: worst / 1e6 for condition, worst in worst_ns.items()},
            },
        )
        for name, latencies in found.items()
    ]
