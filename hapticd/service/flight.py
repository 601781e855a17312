"""Recovery after a crash, at the next start or by ``recover``: the fault is latched, the last rows become a run file."""

from __future__ import annotations

import contextlib
import errno
import faulthandler
import logging
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hapticd.config import paths
from hapticd.record import RecordingError, RunFileError
from hapticd.record.files import open_new_run
from hapticd.record.flight import PAST_S, SUFFIX, Flight, FlightRing, dead, memory_directory
from hapticd.service.heat import Heat
from hapticd.service.latch import FaultLatch
from hapticd.servo import atomics, faults, layout
from hapticd.servo.realtime import Grant
from hapticd.servo.thread import ring_rows

if TYPE_CHECKING:
    from hapticd.config import Config

log = logging.getLogger(__name__)

LOST = f"the last {PAST_S:g} s, and up to a second of what the motor has taken (I²t), do not outlive a crash"
"""The consequence of having no flight recorder."""
_CRASH_SUFFIX = ".crash"
_SIGNAL = re.compile(r"^Fatal Python error: (.+)$", re.MULTILINE)
_LONGEST_CRASH = 1 << 16
_PORTION_ROWS = 4096


@dataclass(frozen=True)
class Recovered:
    """A flight recorder that was converted to a run file.

    Attributes:
        run: the run file.
        rows: number of its rows.
        torn: number of rows that a power cut left incomplete.
        pid: the dead daemon's process number.
        reason: why it died, as far as known.
    """

    run: Path
    rows: int
    torn: int
    pid: int
    reason: str


def flight_directory(config: Config) -> Path | None:
    """Folder of the flight recorder for this config; None if there is no file system in memory."""
    return Path(config.record.flight_directory) if config.record.flight_directory else memory_directory()


def open_ring(config: Config, name: str) -> tuple[FlightRing | None, Grant]:
    """The flight recorder of a new rig, and its line for the banner.

    Args:
        config: for the directory and the rate.
        name: of this daemon.
    """
    directory = flight_directory(config)
    what = "flight recorder"
    if directory is None:
        fix = "set record.flight_directory to a folder on a tmpfs"
        return None, Grant(what, False, f"no file system in memory: {LOST}", fix)
    try:
        ring = FlightRing.create(directory, name, ring_rows(config.servo.rate_hz), atomics.SIZE, atomics.RING_HEAD)
    except RecordingError as error:
        return None, Grant(what, False, f"{error}: {LOST}", f"make room in {directory}")
    return ring, Grant(what, True, f"the last {PAST_S:g} s outlive a crash in {directory}")


@contextlib.contextmanager
def crash_log(config: Config, name: str) -> Iterator[None]:
    """On a fatal signal, write the stack of every thread to a file next to the flight recorder."""
    directory = flight_directory(config)
    if directory is None or faulthandler.is_enabled():
        yield
        return
    path = directory / f"{name}-{os.getpid()}{_CRASH_SUFFIX}"
    try:
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        if reason := paths.foreign(directory):
            raise PermissionError(errno.EPERM, reason)
        file = path.open("w")
    except OSError as error:
        log.warning("a crash will leave no stack: %s: %s", path, error.strerror)
        yield
        return
    with file:
        faulthandler.enable(file)
        try:
            yield
        finally:
            faulthandler.disable()
    path.unlink(missing_ok=True)


def recover(directory: Path, name: str, out: Path | None = None) -> list[Recovered]:
    """Convert every flight recorder of dead daemons to a run file, oldest first; failures are logged, and the file is left.

    Fault and I²t of such a file have been recovered all the same; the next call does not recover them again.

    Args:
        directory: of the flight recorders.
        name: of the daemon; empty for all daemons of this user.
        out: folder of the run files; None: the dead daemon's folder.
    """
    if reason := paths.foreign(directory):
        log.error("nothing is recovered: %s", reason)
        return []
    found = []
    for path in sorted(directory.glob(f"{name}*{SUFFIX}"), key=lambda path: path.stat().st_mtime):
        try:
            with dead(path) as flight:
                if flight is None:
                    continue
                name_of_it = re.sub(rf"-{flight.pid}-\d+$", "", path.stem)
                if not _taken_over(path).exists():
                    _latch(name_of_it, flight)
                    Heat(name_of_it).recovered(atomics.heat(flight.shared))
                    _taken_over(path).touch()
                crash = _crash_text(path, flight.pid)
                recovered = _write(flight, out, crash)
                path.unlink(missing_ok=True)
                _taken_over(path).unlink(missing_ok=True)
                _crash_path(path, flight.pid).unlink(missing_ok=True)
        except (RecordingError, RunFileError, OSError) as error:
            log.error("what a dead daemon left in %s could not be recovered: %s", path, error)
        else:
            if recovered is not None:
                found.append(recovered)
    return found


def fault_of(flight: Flight) -> dict[str, Any] | None:
    """The fault of a dead daemon, as from `hapticd.servo.faults.describe`; None without a fault."""
    number = int(flight.shared[atomics.FAULT_CODE])
    if int(flight.shared[atomics.MODE]) != layout.FAULT or number not in faults.KINDS:
        return None
    value, limit = atomics.fault_numbers(flight.shared)
    config = flight.metadata.get("config", {})
    is_linear = bool(config.get("encoder", {}).get("counts_per_metre"))
    detail = "the daemon was killed before it had written this down"
    return {
        **faults.describe(number, value, limit, is_linear=is_linear, detail=detail),
        "time": _died(flight),
        "config": "that of the daemon that was killed",
        "config_digest": str(flight.metadata.get("config_digest", "")),
    }


def heat_left(config: Config, name: str) -> float:
    """I²t in flight recorders of dead daemons that `recover` could not convert, A² s; 0 if there are none.

    Args:
        config: for the directory. name: of the daemon.
    """
    directory = flight_directory(config)
    if directory is None or paths.foreign(directory):
        return 0.0
    most = 0.0
    for path in directory.glob(f"{name}-*{SUFFIX}"):
        with contextlib.suppress(RunFileError, OSError), dead(path) as flight:
            if flight is not None and not _taken_over(path).exists():
                most = max(atomics.heat(flight.shared), most)
    return most


def _taken_over(path: Path) -> Path:
    """Path of the marker that fault and I²t of a flight recorder have been recovered."""
    return path.with_suffix(".taken-over")


def _latch(name: str, flight: Flight) -> None:
    """Latch the fault of a dead daemon, unless one is latched already.

    Raises:
        OSError: it cannot be written; the flight recorder is left for the next start.
    """
    latch = FaultLatch(name=name)
    fault = fault_of(flight)
    if fault is None or latch.load() is not None:
        return
    latch.store(fault)
    log.warning("the daemon that was killed had a fault: %s: %s", fault["code"], fault["cause"])


def _write(flight: Flight, out: Path | None, crash: str) -> Recovered | None:
    """Write the run file; None if there are no rows."""
    if not flight.rows.size:
        return None
    code, reason = why(flight, crash)
    config = flight.metadata.get("config", {})
    folder = out or Path(config.get("record", {}).get("directory") or flight.path.parent)
    metadata = {
        **flight.metadata,
        "kind": "crash",
        "label": code,
        "reason": reason,
        "crash": crash or None,
        "died_utc": _died(flight),
        "torn_rows": flight.torn,
        "lost_rows": int(flight.shared[atomics.DROPPED]),
    }
    with open_new_run(folder, "crash", code, metadata) as writer:
        for start in range(0, flight.rows.size, _PORTION_ROWS):
            writer.write(flight.rows[start : start + _PORTION_ROWS])
    return Recovered(writer.path, flight.rows.size, flight.torn, flight.pid, reason)


def why(flight: Flight, crash: str = "") -> tuple[str, str]:
    """Why a daemon died, as far as known: a short name and a sentence.

    Args:
        flight: its flight recorder.
        crash: the stacks of its fatal signal.
    """
    mode = int(flight.shared[atomics.MODE])
    state = layout.STATE_NAMES[mode] if 0 <= mode < len(layout.STATE_NAMES) else f"unknown ({mode})"
    number = int(flight.shared[atomics.FAULT_CODE])
    during = f"in state {state}"
    if number in faults.KINDS:
        during += f" with the fault {faults.KINDS[number].code}"
    if signal := _SIGNAL.search(crash):
        return "signal", f"the daemon died {during} of a fatal signal: {signal[1]}"
    if flight.rebooted:
        return "reboot", f"the machine stopped or lost power {during}"
    after_s = flight.rows["time_s"][-1]
    return (
        "killed",
        f"the daemon was killed {during}, {after_s:.3f} s after its start, by SIGKILL or for want of memory",
    )


def _died(flight: Flight) -> str:
    """Time of its last heartbeat, UTC: within 50 ms of its death, unless the supervisor had stopped before."""
    instant_s = (flight.clock_ns + int(flight.shared[atomics.HEARTBEAT_NS])) * 1e-9
    with contextlib.suppress(ValueError, OverflowError):
        return datetime.fromtimestamp(instant_s, UTC).isoformat(timespec="milliseconds")
    return "unknown"


def _crash_path(path: Path, pid: int) -> Path:
    return path.with_name(re.sub(rf"-{pid}-\d+$", f"-{pid}", path.stem) + _CRASH_SUFFIX)


def _crash_text(path: Path, pid: int) -> str:
    with contextlib.suppress(OSError):
        return _crash_path(path, pid).read_text(errors="replace")[:_LONGEST_CRASH]
    return ""
