"""Who may set the motor in motion: each state of a command, and a stop that meets a beginning at every instant."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from hapticd.servo import authority, layout
from hapticd.servo.authority import Authority, Command, Withdrawn
from hapticd.servo.core import Request, ServoCore, parameters
from tests.servo.scripted import Scripted, config, fault_code

LONG_S = 60.0
ROUNDS = 200


def code_of(refused: Callable[[], None]) -> str:
    with pytest.raises(Withdrawn) as withdrawn:
        refused()
    return withdrawn.value.code


def never(ordinal: int) -> None:
    pytest.fail(f"ordinal {ordinal} was published")


def test_an_ordinal_is_when_its_command_was_sent() -> None:
    given, before = Authority(), time.monotonic_ns()
    assert before < given.arrived(LONG_S).ordinal <= time.monotonic_ns()
    assert given.arrived(LONG_S, sent_ns=before).ordinal == before > authority.FIRST
    assert given.arrived(LONG_S, sent_ns=before + 10**12).ordinal <= time.monotonic_ns(), "not from the future"


def test_a_stop_revokes_what_was_sent_before_it_and_is_read_after_it() -> None:
    given, sent_ns = Authority(), time.monotonic_ns()
    given.stop()
    assert code_of(lambda: given.arrived(LONG_S, sent_ns=sent_ns).begin(never)) == "stopped"
    given.arrived(LONG_S, sent_ns=time.monotonic_ns()).begin(lambda _: None)


def test_a_command_begins_by_publishing_its_ordinal() -> None:
    command, published = Authority().arrived(LONG_S), list[int]()
    command.begin(published.append)
    assert published == [command.ordinal]


@pytest.mark.parametrize("name", ["stop", "estop", "end"])
def test_a_stop_revokes_what_came_before_it(name: str) -> None:
    given = Authority()
    before = given.arrived(LONG_S)
    getattr(given, name)()
    assert before.is_revoked()
    assert code_of(lambda: before.begin(never)) == "stopped"
    after = given.arrived(LONG_S)
    assert after.is_revoked() == (name == "end")
    assert given.load(authority.ESTOPS) == (name == "estop")


def test_a_stop_while_nothing_waits_takes_nothing_back() -> None:
    given = Authority()
    given.stop()
    given.stop()
    given.arrived(LONG_S).begin(lambda _: None)


def test_a_command_that_was_begun_is_revoked_as_well() -> None:
    given = Authority()
    command = given.arrived(LONG_S)
    command.begin(lambda _: None)
    command.refuse()
    given.stop()
    assert code_of(command.refuse) == "stopped"


def test_what_was_answered_does_not_begin() -> None:
    command = Authority().arrived(LONG_S)
    command.answered()
    assert code_of(lambda: command.begin(never)) == "answered"


def test_what_has_begun_goes_on_once_it_is_answered() -> None:
    command = Authority().arrived(LONG_S)
    command.begin(lambda _: None)
    command.answered()
    command.refuse()


def test_a_deadline_ends_what_waits_and_not_what_has_begun() -> None:
    late, in_time = Authority().arrived(-0.5), Authority().arrived(LONG_S)
    with pytest.raises(Withdrawn, match=r"its turn came 0\.5 s after its deadline") as withdrawn:
        late.begin(never)
    assert withdrawn.value.code == "expired"
    begun = Command(Authority(), authority.FIRST + 1, time.monotonic() + 0.05, lambda: True)
    begun.begin(lambda _: None)
    time.sleep(0.1)
    begun.refuse()
    in_time.begin(lambda _: None)


def test_the_earlier_of_two_deadlines_counts() -> None:
    given = Authority()
    assert code_of(given.arrived(LONG_S, not_after_s=time.monotonic() - 1.0).refuse) == "expired"
    assert code_of(given.arrived(-1.0, not_after_s=math.inf).refuse) == "expired"
    given.arrived(LONG_S, not_after_s=time.monotonic() + LONG_S).refuse()


def test_a_command_dies_with_its_client() -> None:
    there = [True]
    command = Authority().arrived(LONG_S, lambda: there[0])
    command.refuse()
    there[0] = False
    assert code_of(lambda: command.begin(never)) == "gone"


def loop(words: NDArray[np.int64]) -> ServoCore:
    """A loop in virtual time, away from its origin; it shares ``words``."""
    driver = Scripted(config(), lambda n: 100)
    driver.open()
    core = ServoCore(driver, ring_rows=1024, excitation_rows=1, words=words)
    core.publish(parameters(driver.config, Request()))
    core.begin(0)
    return core


def commanded(core: ServoCore, ticks: int) -> bool:
    """Whether there was current within so many ticks."""
    core.drain()
    core.run(real_time=False, ticks=ticks)
    return bool(np.any(core.drain()["current_command_A"]))


def asks(core: ServoCore, **wanted: int) -> None:
    core.publish(parameters(core.driver.config, Request(**wanted)))


def test_the_tick_renders_for_an_ordinal_until_it_is_revoked() -> None:
    given = Authority()
    core, first = loop(given.words), given.arrived(LONG_S)
    first.begin(lambda ordinal: asks(core, state=layout.RUNNING, ordinal=ordinal))
    assert commanded(core, 10)
    given.stop()
    assert not commanded(core, 10), "not even in the first tick"
    second = given.arrived(LONG_S)
    assert not commanded(core, 10), "nobody has begun it"
    second.begin(lambda ordinal: asks(core, state=layout.RUNNING, ordinal=ordinal))
    assert commanded(core, 10)


def test_the_tick_refuses_what_was_revoked_between_its_publication_and_the_tick() -> None:
    given = Authority()
    core = loop(given.words)
    given.arrived(LONG_S).begin(lambda ordinal: asks(core, state=layout.RUNNING, ordinal=ordinal))
    given.stop()
    assert not commanded(core, 10)


@pytest.mark.parametrize("comes", ["before", "after"])
def test_a_clear_counts_for_a_fault_that_was_there_when_it_came(comes: str) -> None:
    given = Authority()
    core = loop(given.words)
    core.run(real_time=False, ticks=1)
    if comes == "before":
        clear = given.arrived(LONG_S)
    given.estop()
    core.run(real_time=False, ticks=1)
    if comes == "after":
        clear = given.arrived(LONG_S)
    asks(core, clear=clear.ordinal)
    core.run(real_time=False, ticks=2)
    assert fault_code(core) == ("estop" if comes == "before" else None)


def test_a_second_estop_outlives_the_clear_of_the_first() -> None:
    given = Authority()
    core = loop(given.words)
    given.estop()
    core.run(real_time=False, ticks=1)
    clear = given.arrived(LONG_S)
    given.estop()
    core.run(real_time=False, ticks=1)
    asks(core, clear=clear.ordinal)
    core.run(real_time=False, ticks=2)
    assert fault_code(core) == "estop"


def test_a_fault_that_no_loop_raised_outlives_the_clears_that_came_before_it() -> None:
    given = Authority()
    clear = given.arrived(LONG_S)
    given.faulted()
    assert given.load(authority.FAULTED) >= clear.ordinal
    assert given.arrived(LONG_S).ordinal > given.load(authority.FAULTED)


def test_no_motion_after_a_stop_has_returned_however_the_two_meet() -> None:
    """Threads arrive and begin while another stops; what a tick may render is looked at once the stop is back."""
    given = Authority()
    core = loop(given.words)
    begun, refused, lock = 0, 0, threading.Lock()
    for _ in range(ROUNDS):
        commands = [given.arrived(LONG_S) for _ in range(3)]
        together = threading.Barrier(4)

        def begins(command: Command, together: threading.Barrier) -> None:
            nonlocal begun, refused
            together.wait()
            try:
                with lock:  # one publisher at a time, as in `Rig.run`
                    command.begin(lambda ordinal: asks(core, state=layout.RUNNING, ordinal=ordinal))
                    begun += 1
            except Withdrawn:
                refused += 1

        threads = [threading.Thread(target=begins, args=(command, together)) for command in commands]
        for thread in threads:
            thread.start()
        together.wait()
        given.stop()
        assert not commanded(core, 4), "a stop has returned"
        for thread in threads:
            thread.join()
        assert not commanded(core, 4), "and nothing comes later"
    assert begun + refused == 3 * ROUNDS
    assert refused > 0
