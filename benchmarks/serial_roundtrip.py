"""One exchange with a serial board over a pseudo-terminal: our driver against a client in C, at 1 kHz.

Both talk to the same board in C, in turns, each first in every other pair, with the same bytes each way, at the same
priority, and with a Python thread of this process computing without end beside them. Timed is what a tick waits for:
SAMPLE, its reply, COMMAND.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.report import BenchmarkError, Figure, NotHereError, progress
from drivers import libc
from drivers.interface import EXCHANGE_WORDS, X_PERIOD_NS
from drivers.serial_dac import SerialDacDriver
from hapticd.config import parse_config
from hapticd.jit import call_driver, njit
from hapticd.servo.clock import sleep_until

if TYPE_CHECKING:
    from numpy.typing import NDArray

PERIOD_NS = 1_000_000
PRIORITY = 80
GOAL = 1.3
PEER = "client in C"
_WARM = 200
_FAILED_NS = 100_000_000
"""An exchange without its reply counts as the client's time-out; ours gives up after half a period."""


@njit("void(int64[::1], int64[::1], int64[::1])")
def _exchanges(pointers: NDArray[Any], clock: NDArray[Any], spent: NDArray[Any]) -> None:
    """Time of each exchange in ns into ``spent``; -1 for one that failed. ``pointers``: read, write, state, exchange."""
    following = libc.now_ns(clock)
    for index in range(len(spent)):
        following += PERIOD_NS
        sleep_until(clock, following)
        began = libc.now_ns(clock)
        result = call_driver(pointers[0], pointers[2], pointers[3])
        result |= call_driver(pointers[1], pointers[2], pointers[3])
        spent[index] = libc.now_ns(clock) - began if result == 0 else -1


def _build(folder: Path) -> Path:
    program = folder / "serial_peer"
    if not shutil.which("gcc"):
        raise NotHereError("gcc is missing: install a C compiler ('sudo apt-get install gcc')")
    source = Path(__file__).with_name("serial_peer.c")
    command = ["gcc", "-O2", "-Wall", "-Wextra", "-o", str(program), str(source)]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    if built.returncode != 0:
        raise BenchmarkError(f"{source.name} does not compile: {built.stderr.strip()}")
    return program


@contextlib.contextmanager
def _board(program: Path) -> Iterator[str]:
    with subprocess.Popen([str(program), "board"], stdout=subprocess.PIPE, text=True) as board:
        try:
            with contextlib.suppress(PermissionError):
                os.sched_setscheduler(board.pid, os.SCHED_FIFO, os.sched_param(PRIORITY))
            assert board.stdout is not None
            yield board.stdout.readline().strip()
        finally:
            board.kill()


@contextlib.contextmanager
def _busy() -> Iterator[None]:
    ended = threading.Event()

    def spin() -> None:
        number = 1
        while not ended.is_set():
            number = (number * 5 + 1) & 0xFFFF

    thread = threading.Thread(target=spin)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _ours(path: str, periods: int, priority: int) -> NDArray[np.int64]:
    driver = SerialDacDriver(parse_config({"driver": {"name": "serial_dac", "port": path}}, "benchmark"))
    spent = np.zeros(periods, np.int64)
    clock, exchange = np.zeros(libc.SCRATCH, np.int64), np.zeros(EXCHANGE_WORDS, np.int64)
    exchange.view(np.float64)[X_PERIOD_NS] = PERIOD_NS

    def run() -> None:
        if priority:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        addresses = (driver.read_address, driver.write_address, driver.state_address, exchange.ctypes.data)
        _exchanges(np.array(addresses, np.int64), clock, spent)

    try:
        driver.open()
        thread = threading.Thread(target=run)
        thread.start()
        thread.join()
    finally:
        driver.close()
    return spent


def _theirs(program: Path, path: str, periods: int, priority: int) -> NDArray[np.int64]:
    words = [str(program), "client", path, str(periods), str(priority)]
    done = subprocess.run(words, capture_output=True, check=False)
    if done.returncode != 0:
        raise BenchmarkError(f"the client in C failed: {done.stderr.decode().strip()}")
    return np.frombuffer(done.stdout, np.int64)


def _priority() -> int:
    """The priority that both get: real time where it is granted, else none."""
    before = os.sched_getscheduler(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError:
        progress("real-time priority is refused; both run without")
        return 0
    os.sched_setscheduler(0, before, os.sched_param(0))
    return PRIORITY


def measure(quick: bool) -> list[Figure]:
    """Ratio of the pooled medians."""
    pairs, periods = (2, 500) if quick else (10, 4000)
    priority = _priority()
    blocks: dict[bool, list[NDArray[np.int64]]] = {True: [], False: []}
    with tempfile.TemporaryDirectory(prefix="hapticd-benchmark-") as folder:
        program = _build(Path(folder))
        with _board(program) as path, _busy():
            for pair in range(pairs):
                for ours in (pair % 2 == 0, pair % 2 == 1):
                    total = periods + _WARM
                    spent = _ours(path, total, priority) if ours else _theirs(program, path, total, priority)
                    blocks[ours].append(spent[_WARM:])
                mine, other = (float(np.median(blocks[ours][-1])) / 1e3 for ours in (True, False))
                progress(f"pair {pair + 1} of {pairs}, hapticd : C, µs at the median: {mine:.1f} : {other:.1f}")
    pooled = {ours: np.concatenate(found) for ours, found in blocks.items()}
    # Beyond half a period ours gives up and asks anew while the client in C waits on: tails cannot be compared.
    failed = {ours: int((spent < 0).sum()) for ours, spent in pooled.items()}
    mine, other = (
        float(np.median(np.where(pooled[ours] < 0, _FAILED_NS, pooled[ours]))) / 1e3 for ours in (True, False)
    )
    details = {"hapticd_us": mine, "c_us": other, "exchanges": pooled[True].size, "priority": priority}
    details |= {"failed": failed[True], "failed_c": failed[False]}
    shown = f"exchange p50: {mine:.1f} µs, in C {other:.1f} µs"
    return [Figure(shown, mine / other, "×", GOAL, peer=PEER, details=details)]
