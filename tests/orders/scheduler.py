"""A scheduler that chooses who goes next: each thread of the daemon is an actor, and exactly one of them runs.

An actor can be interrupted where the product meets another thread: at a lock, an event, a queue, a sleep, and wherever
it reads or publishes what the loop shares with it. Time passes when the loop ticks, and only then, so that an actor may
stand still for as long as the seed likes. One seed, one run.
"""

from __future__ import annotations

import heapq
import itertools
import random
from collections.abc import Callable
from typing import Final

from greenlet import GreenletExit, getcurrent, greenlet

PERIOD_NS: Final = 1_000_000
"""Of the virtual servo loop."""
_WEIGHTS: Final = (1.0, 1.0, 0.3, 0.03)
"""How often an actor is chosen, one of them drawn for each: the slow ones make the long queues."""


class Stuck(Exception):  # noqa: N818 - what a run comes to
    """Everybody waits for something that nobody will do."""


class Actor:
    """A thread of the daemon."""

    def __init__(self, run: Callable[[], None], name: str, weight: float, hub: greenlet) -> None:
        self.name, self.weight = name, weight
        self.error: BaseException | None = None
        self.alive = True
        self.turn = 0
        """Counts its waits: a timer that is older than the wait at hand wakes nobody."""
        self.greenlet = greenlet(self._body, parent=hub)
        self._run = run

    def _body(self) -> None:
        try:
            self._run()
        except GreenletExit:
            pass
        except BaseException as error:
            self.error = error
        self.alive = False


class Scheduler:
    """Runs actors one at a time.

    Args:
        seed: of every choice.
        tick: has the loop do that many ticks.
    """

    def __init__(self, seed: str, tick: Callable[[int], None]) -> None:
        self.random = random.Random(seed)
        self.now_ns = 1_000_000_000
        self._stamped_ns = 0
        self.actors: list[Actor] = []
        self._tick = tick
        self._tick_weight = self.random.choice((0.1, 0.5, 2.0))
        self._boldness = self.random.choice((0.02, 0.1, 0.4))
        self._ready: list[Actor] = []
        self._timers: list[tuple[int, int, Actor, int]] = []
        self._order = itertools.count()
        self._hub = getcurrent()
        self._ended = False
        self.current: Actor | None = None

    def stamp_ns(self) -> int:
        """The time, which is never twice the same: later than the tick at hand, earlier than the next."""
        self._stamped_ns = max(self._stamped_ns, self.now_ns) + 1
        return self._stamped_ns

    def spawn(self, run: Callable[[], None], name: str, weight: float | None = None) -> Actor:
        """A new actor, which has not run yet."""
        actor = Actor(run, name, self.random.choice(_WEIGHTS) if weight is None else weight, self._hub)
        self.actors.append(actor)
        self._ready.append(actor)
        return actor

    def pause(self) -> None:
        """Let others go first, perhaps."""
        if self.current is not None:
            self._ready.append(self.current)
            self._leave()

    def perhaps(self) -> None:
        """The same, seldom: for what an actor does often."""
        if self.current is not None and not self._ended and self.random.random() < self._boldness:
            self.pause()

    def block(self, until_ns: int | None) -> None:
        """Wait until :meth:`wake` or that time; whoever calls looks again at what it waits for."""
        actor = self.current
        assert actor is not None, "only an actor can wait"
        if until_ns is not None:
            heapq.heappush(self._timers, (until_ns, next(self._order), actor, actor.turn))
        self._leave()

    def wake(self, actor: Actor) -> None:
        """It may look again."""
        if actor not in self._ready:
            self._ready.append(actor)

    def sleep(self, seconds: float) -> None:
        """Sleep in virtual time."""
        until = self.now_ns + max(0, round(seconds * 1e9))
        while self.now_ns < until:
            self.block(until)
        self.pause()

    def advance(self, ticks: int) -> None:
        """Nobody runs but the loop, for so many periods: as when the process is frozen."""
        self.now_ns += ticks * PERIOD_NS
        self._tick(ticks)

    def run(self, done: Callable[[], bool], limit_s: float) -> bool:
        """Have the actors run until ``done``; False when that took longer.

        Raises:
            Stuck: nobody can go on.
            BaseException: what ended an actor.
        """
        until = self.now_ns + round(limit_s * 1e9)
        while not done():
            if self.now_ns > until:
                return False
            self._fire()
            if not self._ready:
                self._skip(until)
                continue
            weights = [actor.weight for actor in self._ready]
            chosen = self.random.random() * (sum(weights) + self._tick_weight)
            for index, weight in enumerate(weights):
                chosen -= weight
                if chosen < 0.0:
                    self._enter(self._ready.pop(index))
                    break
            else:
                self.advance(1)
        return True

    def end(self) -> None:
        """Every actor ends where it stands."""
        self._ended = True
        for actor in self.actors:
            if actor.alive and actor.greenlet:
                self.current = actor
                actor.greenlet.throw(GreenletExit)
            self.current = None

    def _fire(self) -> None:
        while self._timers and self._timers[0][0] <= self.now_ns:
            _, _, actor, turn = heapq.heappop(self._timers)
            if actor.alive and actor.turn == turn:
                self.wake(actor)

    def _skip(self, until_ns: int) -> None:
        """Time passes until somebody has something to do."""
        while self._timers and self._timers[0][2].turn != self._timers[0][3]:
            heapq.heappop(self._timers)
        if not self._timers:
            raise Stuck
        wait_ns = min(self._timers[0][0], until_ns + 1) - self.now_ns
        self.advance(max(1, -(-wait_ns // PERIOD_NS)))

    def _enter(self, actor: Actor) -> None:
        actor.turn += 1
        self.current = actor
        actor.greenlet.switch()
        self.current = None
        if not actor.alive:
            self.actors.remove(actor)
            if actor.error is not None:
                raise actor.error

    def _leave(self) -> None:
        if self._ended:
            raise GreenletExit
        self._hub.switch()
