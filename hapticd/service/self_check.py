"""The daemon looks at itself once a second: what it can mend it mends; what not, it says in `status` and in the log.

Two permanent threads, so that a disk that hangs keeps nobody from seeing that a socket is gone: one for what is in memory,
one for what asks the disk of the recordings. No lock is taken, and nothing here is waited for by a stop or by the heartbeat.
A check that hangs is seen by its age in `status`. What is found is written to the log when it changes.
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
"""Age of a check after which it is said that it hangs."""


@dataclass(frozen=True)
class Look:
    """What one look of a check found.

    Attributes:
        found: what is not as it should be; None: all is well. A new text here or in `done` is a new line in the log.
        done: what was done about it, or what a person can do.
        mended: whether it is right again.
        figures: numbers that are shown in any case, unit in the name.
        said: whether the log has it already.
    """

    found: str | None = None
    done: str = ""
    mended: bool = False
    figures: Mapping[str, float | None] = field(default_factory=dict)
    said: bool = False


Check = Callable[[], Look]


@dataclass(frozen=True)
class _Entry:
    """What is known from a check. Replaced as a whole, so that a reader needs no lock."""

    check: Check
    slow: bool
    answered: float
    ok: bool = True
    found: str | None = None
    done: str | None = None
    time: str | None = None
    last: tuple[str, str] | None = None
    """What the look before found and did; `found` and `done` stay when all is well again."""
    figures: Mapping[str, float | None] = field(default_factory=dict)


class SelfCheck:
    """Looks once a second; its threads exist from the start, and checks may be added at any time.

    Raises:
        RuntimeError: the system gives no thread.
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
        """Look at one more thing from now on.

        Args:
            name: what is looked at, for `status` and log.
            check: called once a second.
            slow: it asks a disk, or something else that may hang.
        """
        self._entries = {**self._entries, name: _Entry(check, slow, time.monotonic())}

    def document(self) -> list[dict[str, Any]]:
        """What was found, as `hapticd.control.schemas.SelfCheck`, one for each check; waits for nothing."""
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
        """Names of its threads, and whether each still runs."""
        return {thread.name: thread.is_alive() for thread in self._threads}

    def end(self) -> None:
        """Look no more. Does not wait for a look that is under way."""
        self._ending.set()

    def look(self, *, slow: bool) -> None:
        """One round, in the calling thread."""
        for name, entry in self._entries.items():
            if entry.slow == slow and not self._ending.is_set():
                look = _asked(entry.check)
                if not self._ending.is_set():  # else what it saw is the end itself
                    self._entries[name] = _after(name, entry, look)

    def _run(self, slow: bool) -> None:
        while not self._ending.wait(self._period_s):
            self.look(slow=slow)

    def _hanging(self) -> Look:
        """Whether another check has not answered for long."""
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
    except Exception as error:  # whatever broke, the others are looked at
        return Look(f"the look at it failed: {type(error).__name__}: {error}")


def _after(name: str, entry: _Entry, look: Look) -> _Entry:
    """The entry after one more look; the log has what is new."""
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
