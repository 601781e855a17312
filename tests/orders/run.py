"""One run: the real daemon on the virtual machine, a script of operations, and at its end a last stop.

Requests go the way of the API: they lie in a socket's buffer, then `Arrivals` when the head is read, then the coroutine that
answers, on one event loop; the bodies come later, the commands are carried out by one thread, in order. Which operation
comes when, who is slow and who goes next is drawn from the seed.
"""

from __future__ import annotations

import contextlib
import contextvars
import functools
import logging
import os
from collections.abc import Callable, Coroutine, Generator, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final
from unittest import mock

from hapticd.config import Config, parse_config
from hapticd.control.endpoints import Endpoints, declared
from hapticd.service import (
    api,
    arrivals,
    background,
    daemon,
    experiments,
    fault_manager,
    halting,
    jobs,
    reconnect,
    rendering,
    replies,
    report,
    rig,
    sequences,
)
from hapticd.service.access import CALLER, Caller, Rules
from hapticd.servo import atomics, authority, layout
from tests.orders.machine import Machine, MemoryLatch, NoHeat, NoSelfCheck, NoStopChannel
from tests.orders.scheduler import PERIOD_NS, Stuck
from tests.orders.standins import Event, Queue, Threading, Time
from tests.orders.trace import Asked, Violation

OPERATIONS: Final = (
    "start",
    "stop",
    "estop",
    "clear",
    "reload",
    "release",
    "excite",
    "sequence",
    "set",
    "let go",
    "hold",
    "gone",
    "deadline",
)
_BODIES: Final[dict[str, dict[str, Any]]] = {
    "release": {"deflection": 40.0, "duration_s": 0.3},
    "excite": {"name": "steps", "amplitude": 0.05, "duration_s": 0.5},
    "sequence": {
        "steps": [
            {"deflection": 40.0, "duration_s": 0.2},
            {"deflection": 41.0, "duration_s": 0.2, "settings": {"spring.stiffness": 0.02}},
        ]
    },
}
_LATE: Final = "late"
"""Answer of the stop channel where it does not see the loop obey."""
_ANSWERED_S: Final = 40.0
"""Virtual time within which every request is answered."""
_AFTER_S: Final = 0.3
"""What may still be waiting has that long to come to light."""
_MODULES: Final = (
    arrivals,
    authority,
    background,
    daemon,
    experiments,
    fault_manager,
    halting,
    jobs,
    reconnect,
    rendering,
    report,
    rig,
)


@functools.cache
def configs() -> tuple[Config, Config]:
    """Two that differ in a key for which the rig is replaced; the shaft is held by friction, away from the origin."""

    def one(coulomb: float) -> Config:
        sections = {
            "plant": {"coulomb": coulomb},
            "spring": {"origin": 0.1},
            "safety": {"guard": "off", "enable": True},
            "amplifier": {"bandwidth_hz": 0},
        }
        return parse_config(sections, "orders")

    return one(1.0), one(1.1)


_ENDPOINTS = {endpoint.name: endpoint for endpoint in declared(Endpoints)}
_MODELS = {
    name: api.body_of(_ENDPOINTS[name]) for name in ("start", "clear", "reload", "release", "excite", "sequence", "set")
}


def _is_numbered(name: str) -> bool:
    return _ENDPOINTS[name].motion_s is not None


class Future:
    """What a coroutine waits for: to be carried out by a thread, or for some time to pass."""

    def __init__(self, scheduler_event: Event, until_ns: int | None = None) -> None:
        self.event, self.until_ns = scheduler_event, until_ns
        self.done = False
        self.result: Any = None
        self.error: BaseException | None = None

    def __await__(self) -> Generator[Future, None, Any]:
        yield self
        if self.error is not None:
            raise self.error
        return self.result


class NoThreadError(RuntimeError):
    """The system gives no thread: said after the command is in the queue, as `ThreadPoolExecutor` does."""


@dataclass(eq=False)
class Client:
    """A connection with one request."""

    asked: Asked
    there: bool = True
    sent_ns: int = 0
    """What the server knows of when it was sent, where it does not say: at the earliest then."""

    def is_there(self) -> bool:
        return self.there


@dataclass
class Api:
    """The API's thread, its event loop, and the pool of the commands.

    Attributes:
        unanswered: requests that wait for their answer, oldest first.
    """

    machine: Machine
    pool_fails: bool
    body_s: float
    unanswered: list[Client] = field(default_factory=list)
    arriving: Asked | None = None
    """Whose head is being looked at, in whatever thread."""

    def __post_init__(self) -> None:
        scheduler = self.machine.scheduler
        self._changed = Event(scheduler)
        self._inbox: list[Client] = []
        self._tasks: list[tuple[Client, Coroutine[Future, None, None], Future, contextvars.Context]] = []
        self._commands = Queue(scheduler)
        self._caller = Caller(1, os.geteuid(), frozenset())

    # What the API asks of asyncio.
    def get_running_loop(self) -> Api:
        return self

    def sleep(self, seconds: float) -> Future:
        return Future(self._changed, self.machine.scheduler.now_ns + round(seconds * 1e9))

    def run_in_executor(self, pool: None, method: Callable[[], Any]) -> Future:
        future = Future(self._changed)
        self._commands.put((future, method))
        if self.pool_fails and self.machine.scheduler.random.random() < 0.3:
            raise NoThreadError
        return future

    def carry_out(self) -> None:
        """The thread of the commands."""
        while True:
            future, method = self._commands.get()
            self.machine.scheduler.perhaps()
            try:
                future.result = method()
            except replies.ANSWERS as error:
                future.error = error
            future.done = True
            self._changed.set()

    def serve(self, control: daemon.Daemon) -> None:
        """The thread of the event loop."""
        answers = {name: api.answering(_ENDPOINTS[name], control, None) for name in _ENDPOINTS}
        scheduler = self.machine.scheduler

        async def app(scope: Any, receive: Any, send: Any) -> None:
            CALLER.set(self._caller)
            client = scope["client"]
            await self.sleep(scheduler.random.random() * self.body_s)
            body = scope["body"]
            await (answers[client.asked.name]() if body is None else answers[client.asked.name](body))

        door = arrivals.Arrivals(app, control, Rules(), _ENDPOINTS.values())
        while True:
            ready = [task for task in self._tasks if self._is_ready(task[2])]
            if self._inbox and (not ready or scheduler.random.random() < 0.5):
                client = self._inbox.pop(0)
                context = contextvars.Context()
                self.arriving = client.asked
                self._step(client, door(self._scope(client), None, None), context)
                self.arriving = None
                if client.asked.arrived is None:
                    self.machine.trace.arrived(client.asked)
            elif ready:
                task = scheduler.random.choice(ready)
                self._tasks.remove(task)
                self._step(task[0], task[1], task[3])
            else:
                self._changed._is_set = False
                due = [task[2].until_ns for task in self._tasks if task[2].until_ns is not None]
                self._changed.wait(max(0.0, (min(due) - scheduler.now_ns) * 1e-9) if due else None)
            scheduler.pause()

    def arrive(self, client: Client) -> None:
        """A request is sent."""
        self.unanswered.append(client)
        self.machine.trace.send(client.asked)
        client.asked.sent_ns = self.machine.scheduler.stamp_ns()
        random = self.machine.scheduler.random
        # an ordinal of its own, by which its command is known here
        client.sent_ns = (
            client.asked.sent_ns - random.choice((0, 1_500_000, 200_000_000)) - random.randrange(9, 900_000)
        )
        self._inbox.append(client)
        self._changed.set()

    def _is_ready(self, future: Future) -> bool:
        return future.done or (future.until_ns is not None and self.machine.scheduler.now_ns >= future.until_ns)

    def _step(self, client: Client, task: Coroutine[Future, None, None], context: contextvars.Context) -> None:
        try:
            future = context.run(task.send, None)
        except StopIteration:
            self.answer(client, None)
        except replies.ANSWERS as error:
            self.answer(client, getattr(error, "code", type(error).__name__))
        except replies.Internal as error:
            if not isinstance(error.__cause__, NoThreadError):
                raise
            self.answer(client, "internal")
        else:
            self._tasks.append((client, task, future, context))

    def answer(self, client: Client, error: str | None) -> None:
        """A request is answered, by whichever way it came."""
        self.unanswered.remove(client)
        self.machine.trace.answer(client.asked, error)

    def _scope(self, client: Client) -> dict[str, Any]:
        asked, random = client.asked, self.machine.scheduler.random
        headers = []
        if _is_numbered(asked.name):
            asked.limit_ns = round((_ENDPOINTS[asked.name].motion_s or 0.0) * 1e9)
            if random.random() < 0.7:
                headers.append((arrivals.SENT, b"%d" % asked.sent_ns))
            if random.random() < 0.5:
                asked.deadline_ns = self.machine.scheduler.now_ns + random.choice((50, 300, 600)) * 1_000_000
                headers.append((arrivals.DEADLINE, b"%d" % asked.deadline_ns))
        model, given = _MODELS.get(asked.name), dict(_BODIES.get(asked.name, {}))
        if asked.name == "set":
            given = {
                "settings": random.choice(({"spring.stiffness": 0.02}, {"spring.origin": random.choice((0.05, 0.1))}))
            }
        return {
            "type": "http",
            "method": "POST",
            "path": _ENDPOINTS[asked.name].path,
            "headers": headers,
            "state": {"caller": self._caller, "connection": client},
            "client": client,
            "body": None if model is None else model(**given),
        }


class Run:
    """The daemon on a machine of its own.

    Args:
        seed: of every choice.
    """

    def __init__(self, seed: str) -> None:
        self.machine = Machine(seed)
        random = self.machine.scheduler.random
        self.api = Api(self.machine, random.random() < 0.1, random.choice((0.0, 0.0, 0.002, 0.05)))
        self._pace_s = random.choice((0.0, 0.0, 0.002, 0.02, 0.3))
        self._reloads = 0
        self._fails_reload = random.random() < 0.1
        self.latch = MemoryLatch(self.machine.scheduler)
        self.control: daemon.Daemon | None = None

    def play(self, script: Sequence[str]) -> None:
        """Play a script, stop at its end, and have what may still wait come to light.

        Raises:
            Violation: a rule does not hold.
        """
        scheduler = self.machine.scheduler
        with self._in_place():
            try:
                scheduler.spawn(self._begin, "main")
                self._until(lambda: self.control is not None, "the daemon begins")
                for operation in script:
                    self._pass_time()
                    self._operate(operation)
                self._until(lambda: not self.api.unanswered, "every request is answered")
                self._finish()
            except Stuck:
                raise Violation("stuck: every thread waits for another") from None
            except Violation:
                raise
            except Exception as error:
                raise Violation(f"failed: a thread ended with {type(error).__name__}: {error}") from error
            finally:
                scheduler.end()

    def _begin(self) -> None:
        control = daemon.Daemon(configs()[0], None, self.latch)
        scheduler = self.machine.scheduler
        scheduler.spawn(lambda: self.api.serve(control), "api", 1.0)
        scheduler.spawn(self.api.carry_out, "commands")
        self.control = control

    def _pass_time(self) -> None:
        """Before the next operation: some steps, some time, or until something has happened."""
        random, events = self.machine.scheduler.random, self.machine.trace.events
        if random.random() < 0.4:
            before, until_ns = len(events) + random.randrange(4), self.machine.scheduler.now_ns + 50_000_000
            self._until(lambda: len(events) > before or self.machine.scheduler.now_ns > until_ns, "something happens")
        else:
            self._idle(random.random() * self._pace_s, random.randrange(12))

    def _idle(self, seconds: float, steps: int = 0) -> None:
        """The actors run for so long, and for so many steps."""
        until_ns = self.machine.scheduler.now_ns + round(seconds * 1e9)

        def done() -> bool:
            nonlocal steps
            steps -= 1
            return steps < 0 and self.machine.scheduler.now_ns >= until_ns

        self._until(done, "time passes")

    def _until(self, done: Callable[[], bool], what: str) -> None:
        if not self.machine.scheduler.run(done, _ANSWERED_S):
            raise Violation(f"slow: it takes more than {_ANSWERED_S:g} s until {what}")

    def _operate(self, operation: str) -> None:
        waiting = [client for client in self.api.unanswered if _is_numbered(client.asked.name) and client.there]
        if operation == "gone":
            for client in waiting[-1:]:
                client.there = False
                self.machine.trace.leaves(client.asked)
        elif operation in ("let go", "hold"):
            self.machine.hold(operation == "hold")
        elif operation == "deadline":
            # The process is frozen, and the loop goes on.
            now_ns = self.machine.scheduler.now_ns
            due = [client.asked.deadline_ns for client in waiting if client.asked.deadline_ns is not None]
            ticks = max(0, max(due, default=now_ns) - now_ns) // PERIOD_NS + 2
            self.machine.trace.note("deadline", f"frozen for {ticks} periods")
            self.machine.scheduler.advance(ticks)
        else:
            self._ask(operation)

    def _ask(self, name: str) -> Asked:
        client = Client(Asked(name))
        if name in ("stop", "estop") and self.machine.scheduler.random.random() < 0.25:
            self.api.unanswered.append(client)
            self.machine.scheduler.spawn(lambda: self._by_channel(client), "channel", 1.0)
        else:
            self.api.arrive(client)
        return client.asked

    def _by_channel(self, client: Client) -> None:
        """As the compiled listener does it (`hapticd.servo.stop_channel`)."""
        assert self.control is not None
        words, name = self.control.authority.words, client.asked.name
        self.machine.scheduler.perhaps()
        self._stop_in_place(client.asked, name, words, self.machine.scheduler.stamp_ns())
        ticks, scheduler = int(words[authority.LOOP_TICKS]), self.machine.scheduler
        ended = (layout.FAULT,) if name == "estop" else (layout.OFF, layout.FAULT)
        until_ns = scheduler.now_ns + 100_000_000
        while words[authority.LOOP_TICKS] < ticks + 2 or words[authority.LOOP_MODE] not in ended:
            if scheduler.now_ns > until_ns:
                self.api.answer(client, _LATE)
                return
            scheduler.sleep(0.0001)
        self.api.answer(client, None)

    def _finish(self) -> None:
        """A last stop works, a harmless setting starts nothing, and nothing comes later."""
        assert self.control is not None
        self.api.pool_fails = False
        for name in ("stop", "set"):
            self._ask(name)
            self._until(lambda: not self.api.unanswered, f"the last {name} is answered")
        for asked in self.machine.trace.asked:
            if asked.is_stop and asked.error not in (None, _LATE):
                raise Violation(f"unanswered: {asked} was answered with {asked.error!r}")
        self._idle(_AFTER_S)
        loops = self.machine.loops
        if len(loops) != 1 or loops[0].core is not self.control.rig.core:
            raise Violation(f"at the end {len(loops)} loops tick")
        if loops[0].core.snapshot["current"] != 0.0:
            raise Violation("after the last stop there is current")
        self._until(self._latch_agrees, "the latch on the disk and the loop agree")

    def _latch_agrees(self) -> bool:
        return (self.machine.loops[0].core.shared[atomics.MODE] == layout.FAULT) == (self.latch.stored is not None)

    def _loaded(self, source: str | None) -> Config:
        self._reloads += 1
        return configs()[self._reloads % 2]

    def _opened(self, config: Config) -> Any:
        if self._reloads and self._fails_reload:
            self.machine.refuses_next, self._fails_reload = True, False
        return self._opened_driver(config)

    _opened_driver = staticmethod(rig.opened_driver)

    def _stop_in_place(self, asked: Asked | None, name: str, words: Any, now_ns: int) -> None:
        STORES[name](words, now_ns)
        if asked is not None:
            self.machine.trace.arrived(asked)

    def _arrived_in_place(self, *arguments: Any, **keywords: Any) -> authority.Command:
        command: authority.Command = self._arrived(*arguments, **keywords)
        if self.api.arriving is not None:
            self.machine.trace.given(self.api.arriving, command.ordinal)
        return command

    def _begin_in_place(self, command: authority.Command, publish: Callable[[int], None]) -> None:
        def told(ordinal: int) -> None:
            self.machine.trace.published(ordinal)
            publish(ordinal)

        self._begins(command, told)

    def _faulted_in_place(self, words: Any, now_ns: int) -> None:
        _FAULTED(words, now_ns)
        self.machine.trace.raised()

    def _load_in_place(self, words: Any, index: int) -> int:
        self.machine.scheduler.perhaps()
        return int(words[index])

    @contextlib.contextmanager
    def _in_place(self) -> Iterator[None]:
        """The daemon's modules on this scheduler."""
        scheduler = self.machine.scheduler
        self._arrived, self._begins = authority.Authority.arrived, authority.Command.begin
        replaced: list[tuple[Any, str, Any]] = [
            (api, "asyncio", self.api),
            (background, "SimpleQueue", lambda: Queue(scheduler)),
            (daemon, "StopChannel", NoStopChannel),
            (daemon, "Heat", NoHeat),
            (daemon, "SelfCheck", NoSelfCheck),
            (daemon, "load_config", self._loaded),
            (experiments, "release_result", lambda *_: {}),
            (sequences, "release_result", lambda *_: {}),
            (rig, "Recorder", self.machine.recorder),
            (rig, "ServoThread", self.machine.servo),
            (rig, "opened_driver", self._opened),
            (authority.Authority, "arrived", lambda *given, **named: self._arrived_in_place(*given, **named)),
            (authority.Command, "begin", lambda command, publish: self._begin_in_place(command, publish)),
            (authority, "faulted", self._faulted_in_place),
            (authority, "_load", self._load_in_place),
            (authority, "stop", lambda *now: self._stop_in_place(self.api.arriving, "stop", *now)),
            (authority, "estop", lambda *now: self._stop_in_place(self.api.arriving, "estop", *now)),
        ]
        for module in _MODULES:
            for name, standin in (("threading", Threading(scheduler)), ("time", Time(scheduler))):
                if hasattr(module, name):
                    replaced.append((module, name, standin))
        with contextlib.ExitStack() as stack, _heard() as errors:
            for owner, name, standin in replaced:
                stack.enter_context(mock.patch.object(owner, name, standin))
            self.machine.trace.clock = lambda: scheduler.now_ns
            yield
        if errors:
            raise Violation(f"failed: the log says {errors[0]}")


_FAULTED = authority.faulted
STORES: Final = {"stop": authority.stop, "estop": authority.estop}


@contextlib.contextmanager
def _heard() -> Iterator[list[str]]:
    """Exceptions that the daemon wrote into its log and went on; nothing else is formatted."""
    errors: list[str] = []

    class Listener(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.exc_info and not isinstance(record.exc_info[1], NoThreadError):
                errors.append(f"{record.getMessage()}: {record.exc_info[1]!r}")

    log, listener = logging.getLogger("hapticd"), Listener()
    before = log.level, log.propagate, log.handlers
    log.setLevel(logging.ERROR)
    log.propagate, log.handlers = False, [listener]
    try:
        yield errors
    finally:
        log.setLevel(before[0])
        log.propagate, log.handlers = before[1:]
