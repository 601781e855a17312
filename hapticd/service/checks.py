"""The checks of the daemon (`hapticd.service.self_check`): sockets, lock, threads, files, latch, limits, disk space."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hapticd.record.files import existing_place, remove_oldest
from hapticd.record.schema import ROW
from hapticd.service.flight import LOST
from hapticd.service.self_check import Check, Look
from hapticd.service.socket import BoundSocket, SocketError, TakenError

if TYPE_CHECKING:
    import socket

    from hapticd.config import Config
    from hapticd.record import Recorder
    from hapticd.service.rig import Rig

log = logging.getLogger(__name__)

OUT_OF_REACH_S = 5.0
"""Time without a reachable socket after which the motor is switched off [s]."""
LOW_MINUTES, ENOUGH_MINUTES = 10.0, 12.0
"""Remaining recording time below which a warning is given, and above which it is withdrawn."""
KEEP_EVERY_S = 10.0
_BATCH_BYTES = 14
"""Overhead of a batch per row at 1 kHz [bytes]."""


class SocketCheck:
    """Whether the daemon is reachable: the files of its sockets and its lock exist and are its own.

    Args:
        bound: the sockets, each with a function to call with a newly bound one, or None.
        out_of_reach: switches the motor off; called once if no socket could be bound again for some seconds, because then
            nobody could stop the motor.
        taken: switches the motor off and ends this daemon; called with the name of the daemon that has replaced it.
    """

    def __init__(
        self,
        bound: Sequence[tuple[BoundSocket, Callable[[socket.socket], None] | None]],
        out_of_reach: Callable[[], object],
        taken: Callable[[str], object],
    ) -> None:
        self._bound, self._out_of_reach, self._taken = bound, out_of_reach, taken
        self._gone_since: float | None = None
        self._stopped = False

    def __call__(self) -> Look:
        """Check, and bind lost sockets again."""
        found, done, mended = [], [], True
        for bound, tell in self._bound:
            if not bound.intact():
                found.append(f"the socket {bound.path} was removed or replaced")
                try:
                    listening = bound.rebind()
                    if tell is not None:
                        tell(listening)
                    done.append(f"bound anew at {bound.path}")
                except TakenError as error:
                    self._taken(str(error))
                    return Look("; ".join(found), f"{error}: the motor is off, and this daemon ends")
                except (SocketError, OSError) as error:
                    mended = False
                    done.append(str(error) or "the API does not answer")
            if bound.lock is not None:
                try:
                    if bound.lock.mend():
                        found.append(f"the lock {bound.lock.path} was removed")
                        done.append("taken anew")
                except Exception as error:
                    found.append(f"the lock {bound.lock.path} was removed")
                    done.append(f"it cannot be taken anew: {error}")
                    mended = False
        if stopped := self._stop_if_gone():
            done.append(stopped)
        return Look("; ".join(found) or None, "; ".join(done), mended)

    def _stop_if_gone(self) -> str | None:
        if any(bound.intact() for bound, _ in self._bound):
            self._gone_since, self._stopped = None, False
            return None
        now = time.monotonic()
        self._gone_since = now if self._gone_since is None else self._gone_since
        if now - self._gone_since < OUT_OF_REACH_S:
            return None
        if not self._stopped:
            self._stopped = True
            self._out_of_reach()
        return f"nobody has been able to reach this daemon for {OUT_OF_REACH_S:g} s: the motor is off"


def flight_recorder(rig: Callable[[], Rig]) -> Check:
    """Whether the flight recorder's file is where the next daemon looks for it. It cannot be restored while the loop runs.

    Args:
        rig: returns the present rig.
    """

    def look() -> Look:
        now = rig()
        ring = now.flight
        if ring is None or ring.intact() or now.closed:  # if closed, we removed it ourselves
            return Look()
        return Look(f"the flight recorder {ring.path} was removed or replaced", f"{LOST}; restart the daemon")

    return look


def latch(unwritable: Callable[[], str | None]) -> Check:
    """Whether a fault could be latched on disk.

    Args:
        unwritable: returns why not, and what to do; None if it could.
    """
    return lambda: Look(unwritable())


def threads(alive: Callable[[], Mapping[str, bool]]) -> Check:
    """Whether all threads run.

    Args:
        alive: returns thread name to whether it runs.
    """

    def look() -> Look:
        ended = sorted(name for name, lives in alive().items() if not lives)
        if not ended:
            return Look()
        return Look(f"the thread {', '.join(ended)} has ended", "restart the daemon; until then it goes on without it")

    return look


def limits(off: Callable[[], Iterable[str]]) -> Check:
    """Whether limits are off.

    Args:
        off: returns their keys, with the limited quantity.
    """

    def look() -> Look:
        keys = list(off())
        return Look(f"no limit is set by {', '.join(keys)}" if keys else None)

    return look


def link(remarks: Callable[[], Sequence[str]]) -> Check:
    """Irregularities of the device's link that are not faults. Each kind is logged once; the counts are in the status.

    Args:
        remarks: of the present driver.
    """
    kinds = 0

    def look() -> Look:
        nonlocal kinds
        texts = list(remarks())
        for text in texts[kinds:]:
            log.warning("%s", text)
        kinds = len(texts)
        return Look("; ".join(texts) or None, "goes on", mended=True, said=True)

    return look


def run_file(recorder: Callable[[], Recorder]) -> Check:
    """Whether the recording is written to its path. The recorder itself continues in a new file.

    Args:
        recorder: returns the present recorder.
    """

    def look() -> Look:
        status: dict[str, Any] = recorder().status()
        if status["error"] is not None:
            return Look(status["error"], "the servo loop goes on, unrecorded", said=True)
        if status["continued"] is not None:
            return Look(status["continued"], mended=True, said=True)
        return Look("the disk of the recording does not answer" if status["stalled_s"] > 1.0 else None)

    return look


class RoomCheck:
    """Remaining recording time of the disk, and ``record.keep``.

    Args:
        config: returns the present config.
        recorder: returns the present recorder.
    """

    def __init__(self, config: Callable[[], Config], recorder: Callable[[], Recorder]) -> None:
        self._config, self._recorder = config, recorder
        self._low = False
        self._looked = -KEEP_EVERY_S
        self._kept = Look()

    def __call__(self) -> Look:
        """Check; remove the oldest run files beyond ``record.keep``."""
        config, recorder = self._config(), self._recorder()
        status = recorder.status()
        row_bytes = status["bytes_per_row"] or ROW.itemsize + _BATCH_BYTES
        room = os.statvfs(existing_place(recorder.directory))
        free = room.f_bavail * room.f_frsize
        minutes = free / (config.servo.rate_hz * row_bytes) / 60.0
        self._low = minutes < (ENOUGH_MINUTES if self._low else LOW_MINUTES)
        if (now := time.monotonic()) - self._looked >= KEEP_EVERY_S:
            self._looked = now
            self._kept = self._keep(config.record.keep, recorder.directory, status["path"])
        figures = {"minutes_left": minutes, "free_bytes": float(free), **self._kept.figures}
        if self._low:
            return Look(
                f"the disk of {recorder.directory} has room for less than {ENOUGH_MINUTES:g} minutes of recording",
                "make room, or set record.keep",
                figures=figures,
            )
        return Look(self._kept.found, self._kept.done, self._kept.mended, figures)

    def _keep(self, most: int | None, directory: Path, path: str | None) -> Look:
        if not most:
            return Look()
        kept = remove_oldest(directory, most, Path(path) if path else None)
        figures = {"run_files_bytes": float(kept.size)}
        if kept.size > most:
            return Look(
                f"the run files in {directory} are larger than record.keep = {most} bytes",
                "none of them may be removed: recorded just now, or of a fault of the last day",
                figures=figures,
            )
        if kept.removed:
            removed = f"removed {len(kept.removed)}, the oldest: {', '.join(path.name for path in kept.removed[:3])}"
            more = ", …" if len(kept.removed) > 3 else ""
            return Look(f"run files were larger than record.keep = {most} bytes", removed + more, True, figures)
        return Look(figures=figures)
