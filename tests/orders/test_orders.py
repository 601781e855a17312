"""Orders of commands: after a stop no current but by a later command, whoever goes next; and a search that can find."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import pytest

from hapticd.servo import atomics, authority, layout
from tests.orders import explore, machine, run
from tests.orders.explore import Script

MOTION = {"start", "release", "excite", "sequence"}
SHARES = 16
"""Of what `make attack` plays, side by side; the drawn sample of `make test` is apart."""
DRAWN_EACH = 600
SAMPLE = 300
MOST_TO_FIND = 2000
"""Orders within which a planted fault is found."""


def no_violation(scripts: Iterable[Script], seed: str, least: int) -> None:
    count, found = explore.explore(scripts, seed)
    assert found is None, f"after {count} orders: {found}"
    assert count >= least


def test_a_drawn_sample_of_orders_breaks_no_rule() -> None:
    no_violation(explore.drawn_orders(SAMPLE, 1, explore.LONGEST, seed=1), "sample", SAMPLE)


@pytest.mark.attack
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("share", range(SHARES))
def test_every_order_up_to_four_and_longer_ones_break_no_rule(share: int) -> None:
    scripts: list[Script] = []
    for length in range(1, explore.EXHAUSTIVE + 1):
        scripts += list(explore.every_order(length))[share::SHARES]
    scripts += explore.drawn_orders(DRAWN_EACH, explore.EXHAUSTIVE + 1, explore.LONGEST, seed=share)
    no_violation(scripts, f"share{share}", 20_000 // SHARES)


def test_a_run_is_the_same_when_it_is_played_again() -> None:
    script = ("reload", "start", "release", "estop", "clear", "excite", "gone")
    stories = []
    for _ in range(2):
        again = run.Run("again")
        again.play(script)
        stories.append(str(again.machine.trace))
    assert stories[0] == stories[1]
    other = run.Run("other")
    other.play(script)
    assert str(other.machine.trace) != stories[0]


@pytest.mark.parametrize("name", sorted(MOTION))
def test_each_command_that_may_move_the_motor_does_so_in_these_runs(name: str) -> None:
    """Or no rule about current would be asked anything."""
    moved = 0
    for number in range(10):
        played = run.Run(f"moves.{number}")
        played.play((name,))
        moved += f"rows  current  {name}" in str(played.machine.trace)
    assert moved > 3


def stop_ends_what_runs(patch: pytest.MonkeyPatch) -> None:
    """As it was: a stop ends what runs, and nothing that waits in a queue."""
    begun, begin = authority.SIZE - 1, authority.Command.begin

    def begin_and_tell(self: authority.Command, publish: Callable[[int], None]) -> None:
        self._authority.words[begun] = self.ordinal
        begin(self, publish)

    def revoke(words: Any, now_ns: int) -> None:
        words[authority.REVOKED] = max(words[authority.REVOKED], words[begun])

    patch.setattr(authority.Command, "begin", begin_and_tell)
    patch.setitem(run.STORES, "stop", revoke)


def tick_begins_unasked(patch: pytest.MonkeyPatch) -> None:
    """Commands are asked whether they are revoked; the tick asks once it renders, and not before."""
    tick, publish = machine.Core.tick, machine.Core.publish
    begins: dict[machine.Core, bool] = {}

    def published(self: machine.Core, params: Any) -> int:
        begins[self] = begins.get(self, False) or (
            params["request"] == layout.RUNNING and params["ordinal"] != self.params["ordinal"]
        )
        return publish(self, params)

    def deaf(self: machine.Core, ticks: int) -> None:
        for _ in range(min(ticks, 5)):
            revoked = int(self.words[authority.REVOKED])
            if begins.get(self):
                self.words[authority.REVOKED] = 0
            tick(self, 1)
            self.words[authority.REVOKED] = revoked
            begins[self] = bool(begins.get(self)) and self.shared[atomics.MODE] != layout.RUNNING
        tick(self, max(0, ticks - 5))

    patch.setattr(machine.Core, "publish", published)
    patch.setattr(machine.Core, "tick", deaf)


def answered_stays_queued(patch: pytest.MonkeyPatch) -> None:
    """As it was: what is in the executor's queue is carried out, whatever its client was told."""
    patch.setattr(authority.Command, "answered", lambda self: None)


def clients_are_immortal(patch: pytest.MonkeyPatch) -> None:
    """As it was: nobody asks whether the client is still there."""
    patch.setattr(run.Client, "is_there", lambda self: True)


def no_deadline(patch: pytest.MonkeyPatch) -> None:
    """As it was: a command waits for ever."""

    arrived = authority.Authority.arrived

    def for_ever(
        self: authority.Authority, _: float, is_there: Callable[[], bool], __: float, sent_ns: int
    ) -> authority.Command:
        return arrived(self, math.inf, is_there, math.inf, sent_ns)

    patch.setattr(authority.Authority, "arrived", for_ever)


def sent_when_it_is_read(patch: pytest.MonkeyPatch) -> None:
    """As it was: what lies in a buffer while a stop is carried out counts as later."""
    arrived = authority.Authority.arrived

    def read_now(self: authority.Authority, limit_s: float, *client: Any) -> authority.Command:
        return arrived(self, limit_s, *client[:-1])

    patch.setattr(authority.Authority, "arrived", read_now)


def any_clear_counts(patch: pytest.MonkeyPatch) -> None:
    """As it was: a clear ends whatever fault it meets."""
    tick = machine.Core.tick

    def forgetful(self: machine.Core, ticks: int) -> None:
        self.words[authority.FAULTED] = 0
        tick(self, ticks)

    patch.setattr(machine.Core, "tick", forgetful)
    patch.setattr(authority.Command, "is_revoked", lambda self: False)


@pytest.mark.parametrize(
    ("plant", "rule", "takes_part", "operations"),
    [
        (stop_ends_what_runs, "stopped", MOTION, run.OPERATIONS),
        (tick_begins_unasked, "stopped", MOTION, ("start", "stop")),  # two ticks wide
        (answered_stays_queued, "answered", MOTION, run.OPERATIONS),
        (clients_are_immortal, "withdrawn", {"gone"}, run.OPERATIONS),
        (no_deadline, "withdrawn", set(), run.OPERATIONS),  # it may be the setting with which each run ends
        (sent_when_it_is_read, "stopped", MOTION, ("start", "stop", "reload")),
        (any_clear_counts, "latched", {"clear"}, run.OPERATIONS),
    ],
)
def test_a_planted_fault_is_found_and_its_shortest_order_can_be_played_again(
    plant: Callable[[pytest.MonkeyPatch], None],
    rule: str,
    takes_part: set[str],
    operations: Sequence[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    plant(monkeypatch)
    scripts = explore.drawn_orders(MOST_TO_FIND, 1, explore.EXHAUSTIVE, 2, operations)
    _, found = explore.explore(scripts, plant.__name__)
    assert found is not None
    assert found.why.startswith(rule), found
    assert len(found.script) <= explore.EXHAUSTIVE
    assert takes_part & set(found.script) or not takes_part
    assert f"again: python -m tests.orders {found.seed} {' '.join(found.script)}\n" in str(found)
    again = explore.attempt(found.script, found.seed)
    assert again is not None
    assert (again.why, again.story) == (found.why, found.story)
