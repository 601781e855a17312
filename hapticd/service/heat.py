"""I²t of the motor's winding above the continuous current, kept over a reload, a lost device and a restart.

The loop integrates it in every tick (`hapticd.servo.gate.check_load`), in A² s, in a word of the flight recorder. It is
written to a file next to the latch at the start, once a second, before a rig is replaced, and at a clean end. A start
subtracts the cooling since then, continuous_current² per second as in the loop, but only after a clean end and only if that
time is known: by the boot clock within one boot, by the calendar over a reboot if it has not gone backwards. After any
other end the start value is the larger of the file's and the flight recorder's; without a flight recorder (no file system
in memory, a power cut) up to a second of heating is lost. An unreadable file counts as a winding at its limit.
"""

from __future__ import annotations

import json
import logging
import math
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hapticd.figures.files import atomic_write
from hapticd.service.latch import state_directory
from hapticd.servo.core import i2t_limit

if TYPE_CHECKING:
    from collections.abc import Callable

    from hapticd.config import Config

log = logging.getLogger(__name__)

_EVERY_S: Final = 1.0
_HANGS_S: Final = 2.0
"""Longest wait for another thread that waits for the disk [s]."""
_UNREADABLE: Final = (ValueError, KeyError, TypeError, RecursionError)
_BOOT = Path("/proc/sys/kernel/random/boot_id")


class Heat:
    """The I²t of one daemon's motor, on disk.

    Args:
        name: of the daemon, `hapticd.service.latch.daemon_name`.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.path = state_directory() / f"heat-{name}.json"
        self._current: Callable[[], float] | None = None
        self._ending = threading.Event()
        self._writing = threading.Lock()
        self._thread: threading.Thread | None = None
        self._written: float | None = None
        self._failed = ""

    def before(self, config: Config, left: float = 0.0) -> float:
        """I²t at the start of a daemon, A² s; at most the limit of ``over_current``.

        Args:
            config: for the continuous current and the limit.
            left: from the flight recorder of a daemon that was killed, A² s.
        """
        limit = i2t_limit(config)
        continuous = config.amplifier.continuous_current
        if not continuous:
            return 0.0
        try:
            kept = self._kept()
            i2t = _i2t(kept)
            cooled = continuous**2 * _known_span_s(kept) if kept["clean"] is True else 0.0
        except FileNotFoundError:
            i2t = cooled = 0.0
        except (OSError, *_UNREADABLE) as error:
            log.warning("%s: %s; the motor is taken to be as hot as it may be", self.path, error)
            return limit
        return min(max(0.0, i2t - cooled, left), limit)

    def recovered(self, left: float) -> None:
        """Store the I²t of a killed daemon's flight recorder before that is removed; no cooling is subtracted then.

        Args:
            left: I²t at its death, A² s; infinite: the limit.

        Raises:
            OSError: the file cannot be read or written; the flight recorder must be kept.
        """
        try:
            before = _i2t(self._kept())
        except FileNotFoundError:
            before = 0.0
        except _UNREADABLE:
            return  # the limit is already stored
        if left > 0.0 or before > 0.0:
            self._store(max(left, before), clean=False)

    def follow(self, current: Callable[[], float]) -> None:
        """Store the I²t now, marked as not clean, and then once a second.

        Args:
            current: returns it, A² s.

        Raises:
            RuntimeError: a thread cannot be created.
        """
        self._current = current
        self.keep()
        self._thread = threading.Thread(target=self._run, name="hapticd-heat", daemon=True)
        self._thread.start()

    def keep(self) -> None:
        """Store it now, before the flight recorder is removed."""
        if self._current is not None:
            self._write(self._current(), clean=False)

    def alive(self) -> bool:
        """Whether its thread runs."""
        return self._thread is not None and self._thread.is_alive()

    def end(self) -> None:
        """Store it as a clean end: the loop has ended, and the motor cools."""
        self._ending.set()
        if self._thread is not None and self._current is not None:
            self._thread.join(_HANGS_S)
            self._write(self._current(), clean=True)

    def _run(self) -> None:
        while not self._ending.wait(_EVERY_S):
            assert self._current is not None
            i2t = self._current()
            if i2t != self._written:  # no write for a cold motor
                self._write(i2t, clean=False)

    def _kept(self) -> Any:
        return json.loads(self.path.read_text())

    def _store(self, i2t: float, *, clean: bool) -> None:
        kept = {
            "i2t": i2t,
            "clean": clean,
            "time_s": time.time(),
            "boot_s": time.clock_gettime(time.CLOCK_BOOTTIME),
            "boot": _boot(),
        }
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(self.path) as part:
            part.write_text(json.dumps(kept) + "\n")

    def _write(self, i2t: float, *, clean: bool) -> None:
        if not self._writing.acquire(timeout=_HANGS_S):
            return  # another thread is waiting for the disk
        try:
            self._store(i2t, clean=clean)
        except OSError as error:
            if str(error) != self._failed:
                self._failed = str(error)
                log.error("what the motor has taken would not outlive a restart: %s: %s", self.path, error.strerror)
        else:
            self._written, self._failed = i2t, ""
        finally:
            self._writing.release()


def _i2t(kept: Any) -> float:
    """I²t of a file's content, A² s; raises one of `_UNREADABLE` if it is invalid."""
    i2t = float(kept["i2t"])
    if not 0.0 <= i2t < math.inf:
        raise ValueError(f"i2t = {i2t}")
    return i2t


def _boot() -> str:
    try:
        return _BOOT.read_text().strip()
    except OSError:
        return ""


def _known_span_s(kept: dict[str, Any]) -> float:
    """Time since it was written, s; 0 if unknown."""
    boot = _boot()
    if boot and kept["boot"] == boot:
        return max(0.0, time.clock_gettime(time.CLOCK_BOOTTIME) - float(kept["boot_s"]))
    return max(0.0, time.time() - float(kept["time_s"]))
