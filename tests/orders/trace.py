"""What happened in a run, in one line of events, and the rules that hold of it.

An ordinal is looked up here by when its command was sent, not by its size: the rules do not take the product's word. What
is sent lies in a socket's buffer until somebody reads it.

| rule | |
|---|---|
| stopped | from the first tick after a stop or an estop on, no current but by a command that was sent later |
| answered | what was answered with an error does not move the motor afterwards |
| withdrawn | it is not handed to the loop after its client has gone or its deadline has passed |
| unanswered | a stop by the API is answered, and not with an error |
| held | while the enable is released there is no current, and after it none but by a command that was sent later |
| latched | from the answer to an estop on there is a fault, until a clear that was sent later; so it is with every fault |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

_ROUNDING_NS: Final = 1000
"""The product's deadlines are in s, as a float."""


@dataclass
class Asked:
    """A request; times are places in the line of events."""

    name: str
    sent: int | None = None
    sent_ns: int = 0
    ordinal: int | None = None
    arrived: int | None = None
    answered: int | None = None
    error: str | None = None
    published: bool = False
    gone: bool = False
    deadline_ns: int | None = None
    """That its client gave, and from its arrival on the earlier of that and the endpoint's own."""
    limit_ns: int = 0

    @property
    def is_stop(self) -> bool:
        return self.name in ("stop", "estop")

    def __str__(self) -> str:
        return self.name if self.ordinal is None else f"{self.name} (ordinal {self.ordinal})"


class Violation(Exception):  # noqa: N818 - what the search is for
    """A rule does not hold."""


@dataclass
class Trace:
    """Events, and a check of each as it comes."""

    events: list[tuple[Any, ...]] = field(default_factory=list)
    asked: list[Asked] = field(default_factory=list)
    clock: Callable[[], int] = lambda: 0
    """Virtual time, ns."""
    _by_ordinal: dict[int, Asked] = field(default_factory=dict)
    _stop: Asked | None = None
    """The newest."""
    _estop: Asked | None = None
    """The newest that was answered."""
    _released: int | None = None
    """When a tick first read that the enable was let go of: what is shorter than a tick nobody can see."""
    _was_held: bool = True
    """By the last tick."""
    _is_held: bool = True
    _is_fault: bool = False
    _faulted: int = 0
    _raised: int | None = None
    _last_row: tuple[Any, ...] = ()

    def note(self, *event: Any) -> None:
        self._last_row = ()
        self.events.append(event)

    def send(self, asked: Asked) -> None:
        """It lies in a socket's buffer from now on."""
        asked.sent = len(self.events)
        self.note("is sent", asked)

    def given(self, asked: Asked, ordinal: int) -> None:
        """A command has its ordinal: this is its arrival."""
        asked.ordinal = ordinal
        own_ns = self.clock() + asked.limit_ns
        asked.deadline_ns = own_ns if asked.deadline_ns is None else min(own_ns, asked.deadline_ns)
        self._by_ordinal[ordinal] = asked
        self.arrived(asked)

    def arrived(self, asked: Asked) -> None:
        asked.arrived = len(self.events)
        self.asked.append(asked)
        self.note("arrives", asked)
        if asked.is_stop:
            self._stop = asked

    def answer(self, asked: Asked, error: str | None) -> None:
        asked.answered, asked.error = len(self.events), error
        self.note("is answered", asked, error or "done")
        if asked.name == "estop" and error is None:
            if self._estop is None or _place(asked) > _place(self._estop):
                self._estop = asked

    def leaves(self, asked: Asked) -> None:
        """Its client hangs up."""
        asked.gone = True
        self.note("client gone", asked)

    def holds(self, held: bool) -> None:
        """A person holds the enable from the next tick on, or does not."""
        self._is_held = held
        self.note("holds" if held else "lets go")

    def raised(self) -> None:
        """A fault, by the daemon while no loop runs; the next loop begins in it."""
        self._raised = len(self.events)
        self.note("a fault is raised")

    def published(self, ordinal: int) -> None:
        """Something is asked of the loop in the name of a command, for the first time or once more."""
        asked = self._by_ordinal.get(ordinal)
        if asked is None:
            raise Violation(f"published: ordinal {ordinal} was given to nobody")
        if asked.published:
            return
        asked.published = True
        self.note("is handed to the loop", asked)
        if asked.gone:
            raise Violation(f"withdrawn: {asked} is handed to the loop after its client has gone")
        if asked.deadline_ns is not None and self.clock() > asked.deadline_ns + _ROUNDING_NS:
            late_s = (self.clock() - asked.deadline_ns) * 1e-9
            raise Violation(f"withdrawn: {asked} is handed to the loop {late_s:.3f} s after its deadline")

    def ticked(self, ticks: int, moves: bool, is_fault: bool, ordinal: int) -> None:
        """Rows of the recording, all of them alike: whether there was current or rendering, and in whose name."""
        if self._was_held and not self._is_held:
            self._released = len(self.events)
        self._was_held = self._is_held
        row = (moves, is_fault, ordinal if moves else 0)
        if row == self._last_row:
            name, *rest, count = self.events[-1]
            self.events[-1] = (name, *rest, count + ticks)
            return  # nothing but time has passed since these rules were asked
        asked = self._by_ordinal.get(ordinal)
        if is_fault and not self._is_fault:
            self._faulted = len(self.events) if self._raised is None else self._raised
            self._raised = None
        elif self._is_fault and not is_fault and not self._cleared_since(self._faulted):
            raise Violation("latched: a fault ends without a clear that came after it")
        self._is_fault = is_fault
        self.note(
            "rows", "current" if moves else "fault" if is_fault else "no current", asked if moves else None, ticks
        )
        self._last_row = row
        if moves:
            self._check_motion(asked)
        estop = self._estop
        if estop is not None and not is_fault and not self._cleared_since(_place(estop)):
            raise Violation(
                "latched: an estop was answered, and the loop is in no fault, without a clear that came later"
            )

    def _check_motion(self, asked: Asked | None) -> None:
        if asked is None:
            raise Violation("stopped: there is current in the name of nobody")
        if self._stop is not None and _place(asked) < _place(self._stop):
            when = "was answered" if self._stop.answered is not None else "arrived"
            raise Violation(
                f"stopped: a {self._stop.name} {when}, and {asked}, which was sent before it, sends current"
            )
        if not self._is_held:
            raise Violation(f"held: the enable is released, and {asked} sends current")
        if self._released is not None and asked.sent is not None and asked.sent < self._released:
            raise Violation(f"held: the enable was released, and {asked}, which was sent before it, sends current")
        if asked.error is not None:
            raise Violation(f"answered: {asked} was answered with {asked.error!r}, and sends current")

    def _cleared_since(self, place: int) -> bool:
        return any(asked.name == "clear" and _place(asked) > place for asked in self.asked)

    def __str__(self) -> str:
        return "\n".join("  " + "  ".join(str(part) for part in event if part is not None) for event in self.events)


def _place(asked: Asked) -> int:
    """When it counts: a stop once it is carried out, anything else when it was sent."""
    place = asked.arrived if asked.is_stop else asked.sent
    assert place is not None
    return place
