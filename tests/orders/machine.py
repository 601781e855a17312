"""The machine under the daemon: the compiled servo loop in virtual time, and memory in place of every disk."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from hapticd.config import Config
from hapticd.record import RecordingError
from hapticd.record.schema import FLAG_FAULT, FLAG_RUNNING
from hapticd.servo import atomics, authority, layout
from hapticd.servo.core import ServoCore
from hapticd.servo.loop import run
from hapticd.servo.realtime import RealtimeError
from tests.orders.scheduler import PERIOD_NS, Scheduler
from tests.orders.standins import Event, Lock
from tests.orders.trace import Trace

RING_ROWS: Final = 1024
EXCITATION_ROWS: Final = 1024
_AT_ONCE: Final = RING_ROWS // 2


class Core(ServoCore):
    """The loop's memory; where the daemon looks into it or publishes, others may go first."""

    def __init__(self, scheduler: Scheduler, trace: Trace, driver: Any, words: Any) -> None:
        super().__init__(driver, ring_rows=RING_ROWS, excitation_rows=EXCITATION_ROWS, words=words)
        self._scheduler, self._trace = scheduler, trace
        self._is_due = False
        self._flags, self._currents = self.ring["flags"], self.ring["current_command_A"]
        self._blocks = (self.memory[0], self.shared, self.words, self.ring, self.truth, self.excitation)

    def load(self, index: int) -> int:
        self._scheduler.perhaps()
        return int(self.shared[index])

    def publish(self, params: np.void) -> int:
        if params["request"] == layout.RUNNING:
            self._trace.published(int(params["ordinal"]))
        if params["clear"] != self.params["clear"]:
            self._trace.published(int(params["clear"]))
        self._scheduler.perhaps()  # between the last look and the store: a stop that comes here is for the tick to see
        return super().publish(params)

    def tick(self, ticks: int) -> None:
        """That many ticks, in portions that the ring holds; each row goes into the trace."""
        while ticks:
            # The first is told apart: in it the loop learns what has changed since the last.
            portion = 1 if self._is_due else min(ticks, _AT_ONCE)
            self._is_due = ticks > portion == _AT_ONCE
            ticks -= portion
            run(*self._blocks, portion)
            self.words[authority.LOOP_MODE] = self.shared[atomics.MODE]
            self.words[authority.LOOP_TICKS] += portion
            head, mask = int(self.shared[atomics.RING_HEAD]), RING_ROWS - 1
            self.shared[atomics.RING_TAIL] = head
            if portion == 1:
                flag = int(self._flags[(head - 1) & mask])
                moves = flag & FLAG_RUNNING != 0 or float(self._currents[(head - 1) & mask]) != 0.0
                is_fault = flag & FLAG_FAULT != 0
            else:
                rows = np.arange(head - portion, head) & mask
                flags = self._flags[rows]
                moves = bool(np.any(self._currents[rows] != 0.0)) or bool(np.any(flags & FLAG_RUNNING))
                is_fault = bool(np.all(flags & FLAG_FAULT))
            self._trace.ticked(portion, moves, is_fault, int(self.params["ordinal"]))


class Servo:
    """`ServoThread`: its loop runs when the scheduler lets time pass."""

    def __init__(
        self, machine: Machine, config: Config, driver: Any, params: np.void, latched: int, words: Any
    ) -> None:
        self.core = Core(machine.scheduler, machine.trace, driver, words)
        self.grants: list[Any] = []
        self._machine, self._params, self._latched, self._obeyed = machine, params, latched, 0
        self._ended = Event(machine.scheduler)

    def start(self) -> None:
        scheduler = self._machine.scheduler
        scheduler.sleep(scheduler.random.choice((0.0, 0.005, 0.1, 0.7)))
        self.core.publish(self._params)
        if self._machine.refuses_next:
            self._machine.refuses_next = False
            raise RealtimeError("the device does not answer")
        mode = layout.FAULT if self._latched else layout.OFF
        self.core.begin(scheduler.now_ns + PERIOD_NS, mode, self._obeyed)
        if self._latched:
            self.core.shared[atomics.FAULT_CODE] = self._latched
        self.core.driver.held = self._machine.held
        self._machine.loops.append(self)
        scheduler.sleep(0.001)

    def obeyed(self, estops: int) -> Servo:
        """What the loop before this one had obeyed."""
        self._obeyed = estops
        return self

    def beat(self) -> None:
        """In virtual time nobody misses it."""

    def alive(self) -> bool:
        return not self._ended.is_set()

    def stop(self, timeout_s: float = 5.0) -> bool:
        self.core.store(atomics.STOP, 1)
        return self._ended.wait(timeout_s) if self in self._machine.loops else True

    def leave(self) -> None:
        """Told to stop: it leaves by way of zero current."""
        self._machine.loops.remove(self)
        fault = int(self.core.shared[atomics.MODE]) == layout.FAULT
        self.core.words[authority.LOOP_MODE] = layout.FAULT if fault else layout.OFF
        self.core.words[authority.LOOP_TICKS] += 1
        self._ended.set()


class MemoryRecorder:
    """`Recorder`: as slow as a disk may be."""

    directory = Path("/nowhere")

    def __init__(self, scheduler: Scheduler) -> None:
        self._scheduler = scheduler
        self._lock = Lock(scheduler)
        self._slowness_s = scheduler.random.choice((0.0, 0.002, 0.05, 0.3))
        self._path: Path | None = None
        self._made = 0

    def start(self, path: str | None = None, label: str = "", more: Mapping[str, Any] | None = None) -> Path:
        with self._lock:
            self._work()
            if self._path is not None:
                raise RecordingError(f"already recording to {self._path}; stop that first")
            self._made += 1
            self._path = self.directory / f"{self._made}-{label}"
            return self._path

    def stop(self) -> Path | None:
        with self._lock:
            self._work()
            path, self._path = self._path, None
            return path

    def annotate(self, event: Mapping[str, Any]) -> None:
        with self._lock:
            self._work()

    def dump_past(self, label: str) -> Path:
        self._work()
        return self.directory / label

    def status(self) -> dict[str, Any]:
        return {"state": "off" if self._path is None else "recording", "path": self._path}

    def shutdown(self) -> Path | None:
        return self.stop()

    def _work(self) -> None:
        self._scheduler.sleep(self._scheduler.random.random() * self._slowness_s)


class MemoryLatch:
    """`FaultLatch`: what would be on the disk."""

    name, number, path = "", 0, Path("/nowhere/fault.json")

    def __init__(self, scheduler: Scheduler) -> None:
        self._scheduler = scheduler
        self.stored: dict[str, Any] | None = None

    def load(self) -> None:
        return None

    def prepare(self) -> None:
        self._scheduler.perhaps()

    def close(self) -> None:
        pass

    def store(self, fault: dict[str, Any]) -> None:
        self._scheduler.sleep(self._scheduler.random.choice((0.0, 0.002, 0.02)))
        self.stored = fault

    def remove(self) -> None:
        self._scheduler.perhaps()
        self.stored = None


class NoHeat:
    """The motor's heat is no affair of orders."""

    name = ""

    def __init__(self, *_: Any) -> None:
        pass

    def before(self, *_: Any) -> float:
        return 0.0

    def follow(self, *_: Any) -> None:
        pass

    def keep(self) -> None:
        pass

    def end(self) -> None:
        pass


class NoSelfCheck:
    """Nothing is taken away from the daemon here."""

    def add(self, *_: Any, **__: Any) -> None:
        pass

    def document(self) -> list[Any]:
        return []

    def end(self) -> None:
        pass


class NoStopChannel:
    """The compiled listener has tests of its own; here its two stores are made by an actor (`tests.orders.run`)."""

    def __init__(self, *_: Any) -> None:
        pass

    def end(self) -> None:
        pass


class Machine:
    """The loops that tick; one of them, or none while a rig is replaced.

    Attributes:
        refuses_next: the next servo loop does not start.
    """

    def __init__(self, seed: str) -> None:
        self.trace = Trace()
        self.loops: list[Servo] = []
        self.refuses_next = False
        self.held = True
        self.scheduler = Scheduler(seed, self._tick)

    def _tick(self, ticks: int) -> None:
        for servo in tuple(self.loops):
            if servo.core.shared[atomics.STOP]:
                servo.leave()
            else:
                servo.core.tick(ticks)

    def hold(self, held: bool) -> None:
        """A person holds the enable input, or lets go of it."""
        self.held = held
        self.trace.holds(held)
        for servo in self.loops:
            servo.core.driver.held = held

    def servo(self, config: Config, driver: Any, params: np.void, latched: int = 0, *_: Any, **words: Any) -> Servo:
        """In place of the class `ServoThread`."""
        return Servo(self, config, driver, params, latched, words["words"]).obeyed(words["estops_obeyed"])

    def recorder(self, *_: Callable[..., Any] | Iterable[Any]) -> MemoryRecorder:
        """In place of the class `Recorder`."""
        return MemoryRecorder(self.scheduler)
