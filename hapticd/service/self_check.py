"""The self-check, once a second: it repairs what it can, and reports the rest in `status` and in the log.

It has two permanent threads, one for checks in memory and one for checks of the recordings' disk, so that a hanging disk
does not hide a lost socket. It takes no lock, and neither a stop nor the heartbeat waits for it. A hanging check shows by
its age in `status`. A result is logged when it changes.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from hapticd.record.metadata import utc_now

log = logging.getLogger(__name__)

PERIOD_S = 1.0
HANGS_S = 5.0
"""Age of a check after which it is reported as hanging [s]."""


@dataclass(frozen=True)
class Look:
    """Result of one check.

    Attributes:
        found: the problem; None for none. A new text here or in `done` is logged.
        done: what was done about it, or what the user can do.
        mended: whether it is repaired.
        figures: numbers that are always shown, with the unit in the name.
        said: whether it is already in the log.
    """

    found: str | None = None
    done: str = ""
    mended: bool = False
    figures: Mapping[str, float | None] = field(default_factory=dict)
    said: bool = False


Check = Callable[[], Look]


@dataclass(frozen=True)
class _Entry:
    """State of a check. It is replaced as a whole, so that a reader needs no lock."""

    check: Check
    slow: bool
    answered: float
    ok: bool = True
    found: str | None = None
    done: str | None = None
    time: str | None = None
    last: tuple[str, str] | None = None
    """The previous result; `found` and `done` are kept after the repair."""
    figures: Mapping[str, float | None] = field(default_factory=dict)


class SelfCheck:
    """Runs all checks once a second; its threads are created at the start, and checks may be added at any time.

    Raises:
        RuntimeError: a thread cannot be created.
    """

    def __init__(self, period_s: float = PERIOD_S) -> None:
        self._period_s = period_s
        self._entries: dict[str, _Entry] = {}
        self._ending = threading.Event()
        self.add("self_check", self._hanging)
        self._threads = [
            threading.Thread(target=self._run, args=(slow,), name=name, daemon=True)
            for name, slow in (("hapticd-check", False), ("hapticd-check-disk", True))
        ]
        for thread in self._threads:
            thread.start()

    def add(self, name: str, check: Check, *, slow: bool = False) -> None:
        """Add a check.

        Args:
            name: of the check, for `status` and log.
            check: called once a second.
            slow: whether it accesses a disk, or may hang for another reason.
        """
        self._entries = {**self._entries, name: _Entry(check, slow, time.monotonic())}

    def document(self) -> list[dict[str, Any]]:
        """Results of all checks, as `hapticd.control.schemas.SelfCheck`; waits for nothing."""
        now = time.monotonic()
        return [
            {
                "what": name,
                "ok": entry.ok,
                "found": entry.found,
                "done": entry.done,
                "time": entry.time,
                "age_s": now - entry.answered,
                "figures": dict(entry.figures),
            }
            for name, entry in list(self._entries.items())
        ]

    def alive(self) -> dict[str, bool]:
        """Name of each thread to whether it runs."""
        return {thread.name: thread.is_alive() for thread in self._threads}

    def end(self) -> None:
        """Stop checking. It does not wait for a running check."""
        self._ending.set()

    def look(self, *, slow: bool) -> None:
        """Run the checks once, in the calling thread."""
        for name, entry in self._entries.items():
            if entry.slow == slow and not self._ending.is_set():
                look = _asked(entry.check)
                if not self._ending.is_set():  # during the shutdown the results are meaningless
                    self._entries[name] = _after(name, entry, look)

    def _run(self, slow: bool) -> None:
        while not self._ending.wait(self._period_s):
            self.look(slow=slow)

    def _hanging(self) -> Look:
        """Report checks that have not returned for a long time."""
        now = time.monotonic()
        hanging = [name for name, entry in self._entries.items() if entry.slow and now - entry.answered > HANGS_S]
        if not hanging:
            return Look()
        return Look(
            f"the look at {', '.join(hanging)} has not come back for more than {HANGS_S:g} s: the disk does not answer"
        )


def _asked(check: Check) -> Look:
    try:
        return check()
    except Exception as error:  # an error in one check must not end the others
        return Look(f"the look at it failed: {type(error).__name__}: {error}")


def _after(name: str, entry: _Entry, look: Look) -> _Entry:
    """The new state of a check; changes are logged."""
    entry = replace(entry, answered=time.monotonic(), figures=look.figures, ok=look.found is None or look.mended)
    if look.found is None:
        return replace(entry, last=None)
    if (look.found, look.done) == entry.last:
        return entry
    if not look.said:
        level = logging.WARNING if look.mended else logging.ERROR
        text = f"{look.found}; {look.done}" if look.done else look.found
        log.log(level, "%s", text, extra={"journal": {"check": name}})
    time_found = utc_now().isoformat("T", "seconds")
    return replace(entry, found=look.found, done=look.done or None, time=time_found, last=(look.found, look.done))
