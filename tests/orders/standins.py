"""What stands in for `threading`, `time` and `queue` in the daemon's modules: the same calls, on a scheduler.

Only what the daemon uses, with its meaning: a lock is handed to whoever the scheduler lets look first.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from tests.orders.scheduler import Actor, Scheduler


class _Waitable:
    """Something that actors wait for."""

    def __init__(self, scheduler: Scheduler) -> None:
        self._scheduler = scheduler
        self._waiting: list[Actor] = []

    def _wait(self, condition: Callable[[], bool], timeout_s: float | None) -> bool:
        scheduler = self._scheduler
        until = None if timeout_s is None or timeout_s < 0 else scheduler.now_ns + round(timeout_s * 1e9)
        while not condition():
            if until is not None and scheduler.now_ns >= until:
                return False
            actor = scheduler.current
            assert actor is not None
            self._waiting.append(actor)
            try:
                scheduler.block(until)
            finally:
                self._waiting.remove(actor)
        return True

    def _changed(self) -> None:
        for actor in self._waiting:
            self._scheduler.wake(actor)


class Lock(_Waitable):
    """A lock; ``again``: whoever has it may take it once more."""

    def __init__(self, scheduler: Scheduler, *, again: bool = False) -> None:
        super().__init__(scheduler)
        self._again, self._owner, self._depth = again, object(), 0

    def acquire(self, blocking: bool = True, timeout: float = -1.0) -> bool:
        self._scheduler.perhaps()
        if not self._wait(self._is_free, (timeout if blocking else 0.0)):
            return False
        self._owner = self._scheduler.current
        self._depth += 1
        return True

    def release(self) -> None:
        self._depth -= 1
        if not self._depth:
            self._changed()
            self._scheduler.perhaps()

    def _is_free(self) -> bool:
        return not self._depth or (self._again and self._owner is self._scheduler.current)

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()


class Event(_Waitable):
    """An event."""

    def __init__(self, scheduler: Scheduler) -> None:
        super().__init__(scheduler)
        self._is_set = False

    def is_set(self) -> bool:
        return self._is_set

    def set(self) -> None:
        self._is_set = True
        self._changed()

    def wait(self, timeout: float | None = None) -> bool:
        self._scheduler.perhaps()
        return self._wait(self.is_set, timeout)


class Queue(_Waitable):
    """`queue.SimpleQueue`."""

    def __init__(self, scheduler: Scheduler) -> None:
        super().__init__(scheduler)
        self._items: deque[Any] = deque()

    def put(self, item: Any) -> None:
        self._items.append(item)
        self._changed()
        self._scheduler.perhaps()

    def get(self) -> Any:
        self._wait(lambda: bool(self._items), None)
        return self._items.popleft()

    def empty(self) -> bool:
        return not self._items


class Thread:
    """`threading.Thread`: an actor."""

    def __init__(
        self,
        scheduler: Scheduler,
        target: Callable[..., None],
        name: str,
        args: tuple[Any, ...] = (),
        daemon: bool = True,
    ) -> None:
        self.name = name
        self._scheduler, self._target, self._args = scheduler, target, args
        self._ended = Event(scheduler)

    def start(self) -> None:
        self._scheduler.spawn(self._run, self.name)

    def is_alive(self) -> bool:
        return not self._ended.is_set()

    def join(self, timeout: float | None = None) -> None:
        self._ended.wait(timeout)

    def _run(self) -> None:
        try:
            self._target(*self._args)
        finally:
            self._ended.set()


class Threading:
    """The module `threading`."""

    def __init__(self, scheduler: Scheduler) -> None:
        self._scheduler = scheduler

    def Lock(self) -> Lock:  # noqa: N802 - as in the module
        return Lock(self._scheduler)

    def RLock(self) -> Lock:  # noqa: N802 - as in the module
        return Lock(self._scheduler, again=True)

    def Event(self) -> Event:  # noqa: N802 - as in the module
        return Event(self._scheduler)

    def Thread(self, **keywords: Any) -> Thread:  # noqa: N802 - as in the module
        return Thread(self._scheduler, **keywords)


class Time:
    """The module `time`."""

    def __init__(self, scheduler: Scheduler) -> None:
        self._scheduler = scheduler
        self.sleep = scheduler.sleep

    def monotonic(self) -> float:
        return self._scheduler.now_ns * 1e-9

    def monotonic_ns(self) -> int:
        self._scheduler.perhaps()
        return self._scheduler.stamp_ns()

    def time(self) -> float:
        return 1.7e9 + self._scheduler.now_ns * 1e-9
