"""Somebody else on the bus, byte for byte: samples that no SYNC asked for, SDO that is not ours, another mode."""

from __future__ import annotations

from collections.abc import Iterator

import can
import pytest

from drivers.canopen import layout as w
from drivers.canopen.reasons import remarks
from drivers.interface import ERROR, LOST, MISSED, OK, X_COUNTS
from tests.drivers.canopen.test_callback import ENABLED as ENABLED_MESSAGE
from tests.drivers.canopen.test_callback import Bench
from tests.drivers.canopen.test_exchange import ENABLED, enable, tick
from tests.drivers.canopen.wire import Wire

FORGED = "< 181#37026206000000FE"  # the same drive, said to be 400 counts further on
SURPLUS = (
    "TPDO 1 of node 1 came without a SYNC ({} times since the start): another node uses its identifier, "
    "or the drive sends it without SYNC, and it is not known which one has the position"
)
WRITTEN = (
    "another client writes {} of the drive (SDO to node 1), so the settings of bring-up may no longer be valid; "
    "the node was stopped by NMT"
)


@pytest.fixture
def wire() -> Iterator[Wire]:
    with Wire() as made:
        enable(made)
        yield made


def test_a_second_node_that_says_something_else_ends_it_the_second_time(wire: Wire) -> None:
    assert wire.read(FORGED, "> 080#", ENABLED) == OK
    assert wire.x[X_COUNTS] == 1234
    assert wire.read(FORGED, "> 080#", ENABLED) == ERROR
    assert wire.why == SURPLUS.format(2)
    assert wire.write(0.5, 1, "> 201#02000000") == OK  # quick stop
    assert wire.read("> 080#", ENABLED) == OK
    assert wire.s[w.UNASKED] == 2


def test_five_repeated_samples_are_a_poor_bus_and_six_are_not(wire: Wire) -> None:
    for _ in range(5):
        assert wire.read(ENABLED, "> 080#", ENABLED) == OK
    assert wire.read(ENABLED, "> 080#", ENABLED) == ERROR
    assert wire.why == SURPLUS.format(6)


def test_what_is_a_second_apart_is_counted_and_passes(wire: Wire) -> None:
    for _ in range(8):
        assert wire.read(FORGED, "> 080#", ENABLED) == OK
        wire.s[w.SURPLUS_SINCE_NS] -= w.SURPLUS_NS + 1  # a second passes
        assert wire.read("> 080#", ENABLED) == OK
    assert wire.s[w.UNASKED] == 8
    assert remarks(wire.s) == ["8 TPDO 1 of node 1 came without a SYNC"]


def test_late_samples_are_no_surplus_however_often(wire: Wire) -> None:
    """Docs/decisions/0077: a late TPDO comes with the next one in one tick."""
    for n in range(6):
        assert wire.read("> 080#", period_ns=2e7) == MISSED
        assert wire.read(period_ns=2e7) == MISSED
        late = f"< 181#3702{n:02X}01000000FE"
        assert wire.read("> 080#", late) == OK
        assert wire.read(ENABLED, "> 080#", ENABLED) == OK
    assert wire.s[w.UNASKED] == 0


def test_a_burst_after_a_stall_is_no_surplus(wire: Wire) -> None:
    """An adapter that stalls, and then delivers all that the drive has answered meanwhile."""
    for _ in range(4):
        assert wire.read("> 080#", period_ns=2e7) == MISSED
        assert wire.read(period_ns=2e7) == MISSED
    burst = [f"< 181#3702{n:02X}01000000FE" for n in range(4)]
    assert wire.read(*burst, "> 080#", ENABLED) == OK
    assert wire.s[w.UNASKED] == 0


def test_an_answer_that_was_lost_excuses_nobody_a_second_later(wire: Wire) -> None:
    assert wire.read("> 080#", period_ns=2e7) == MISSED
    assert wire.read(period_ns=2e7) == MISSED
    assert wire.read("> 080#", ENABLED) == OK
    assert wire.s[w.DUE] == 1
    wire.s[w.UNANSWERED_NS] -= w.SURPLUS_NS + 1
    assert wire.read("> 080#", ENABLED) == OK
    assert wire.read(FORGED, "> 080#", ENABLED) == OK
    assert wire.read(FORGED, "> 080#", ENABLED) == ERROR


@pytest.mark.parametrize(
    ("heard", "what"),
    [
        ("581#6060600000000000", "object 0x6060"),
        ("581#6072600000000000", "object 0x6072"),
        ("581#6071600000000000", "object 0x6071"),
        ("581#607A600000000000", "object 0x607a"),
        ("581#6040600000000000", "object 0x6040"),
        ("581#6000230000000000", "object 0x2300"),
        ("581#6000140100000000", "object 0x1400:1"),
        ("581#A472600020000000", "object 0x6072"),  # block download
        ("581#2000000000000000", "an object"),  # segments
        ("581#3000000000000000", "an object"),
        ("601#2F60600003000000", "object 0x6060"),  # where the request itself is heard
        ("601#2B726000FF7F0000", "object 0x6072"),
        ("601#C272600008000000", "object 0x6072"),
        ("601#0011223344556677", "an object"),
    ],
)
def test_somebody_elses_write_is_the_end(wire: Wire, heard: str, what: str) -> None:
    assert wire.read("> 080#", f"< {heard}") == LOST
    assert wire.why == WRITTEN.format(what)
    assert wire.write(0.5, 1, "> 201#02000000", "> 000#0201") == LOST  # quick stop, NMT stop
    assert wire.read() == LOST
    assert wire.write(0.0, 0, "> 201#00000000") == LOST
    assert wire.nothing_sent()


def test_somebody_elses_write_counts_while_off_too() -> None:
    with Wire() as wire:
        assert wire.read("< 581#6060600000000000") == LOST
        assert wire.write(0.0, 0, "> 201#00000000", "> 000#0201") == LOST


@pytest.mark.parametrize(
    "heard",
    [
        "581#4F61600003000000",  # a value
        "581#4341600050020000",
        "581#8060600030000906",  # a write that the drive has refused
        "581#1011223344556677",  # a segment of a value
        "581#C672600020000000",  # the beginning of a block
        "601#4061600000000000",
        "601#6000000000000000",
        "601#A372600000000000",
        "601#8060600000000405",
    ],
)
def test_somebody_elses_reads_are_counted(wire: Wire, heard: str) -> None:
    for _ in range(3):
        assert wire.read(f"< {heard}", "> 080#", ENABLED) == OK
        assert wire.write(0.0, 1, "> 201#0F000000") == OK
    assert wire.why is None
    assert remarks(wire.s) == [
        "another client reads objects of the drive: 3 SDO frames of node 1 were not for this driver"
    ]


@pytest.mark.parametrize("answer", ["4B3F600010420000", "803F600000000206"])
def test_the_answer_to_our_own_question_is_nobody_elses(wire: Wire, answer: str) -> None:
    faulty = "< 181#1802D204000000FE"
    wire.read("> 080#", faulty)
    wire.write(0.0, 1, "> 201#02000000", "> 601#403F600000000000")
    wire.read("> 080#", f"< 581#{answer}", faulty)
    assert (wire.s[w.SDO_SEEN], wire.s[w.REASON]) == (0, 0)


@pytest.fixture
def shown() -> Iterator[Wire]:
    """The mode of operation, 10, comes back behind the demand."""
    with Wire(read_back=True) as made:
        made.s[w.MODE] = made.s[w.MODE_WANTED] = 10
        enable(made)
        yield made


def test_another_mode_of_operation_is_the_end_in_its_first_sample(shown: Wire) -> None:
    for _ in range(3):
        assert tick(shown, "00000A", 0.0, "0F000000") == OK
    assert tick(shown, "000003", 0.0, "02000000", "> 000#0201") == LOST
    assert shown.why == (
        "node 1 is in mode of operation 3, no longer in 10: another client has changed it; the node was stopped by NMT"
    )


def test_another_mode_says_nothing_while_the_drive_is_off(shown: Wire) -> None:
    off = "< 181#5002D204000000FE"
    for shows in ("00000A", "000003", "0000FF"):
        assert shown.read(f"< 281#{shows}", "> 080#", off) == OK
        assert shown.write(0.0, 0, "> 201#00000000") == OK


def test_a_read_back_without_the_mode_is_an_error_where_it_is_mapped(shown: Wire) -> None:
    assert shown.read("< 281#0000") == ERROR
    assert shown.why is not None
    assert shown.why.startswith("TPDO 2 of node 1 came with 2 bytes, 3 are mapped")


def test_through_python_can_it_is_the_same() -> None:
    bench = Bench(echoes=True)
    forged = can.Message(arbitration_id=0x181, is_extended_id=False, data=bytes.fromhex("37026206000000FE"))
    assert bench.tick(0.0, ENABLED_MESSAGE)[:2] == (OK, OK)
    assert bench.tick(0.0, forged, ENABLED_MESSAGE)[:2] == (OK, OK)
    assert [bench.tick(0.0, forged, ENABLED_MESSAGE)[0] for _ in range(2)] == [OK, ERROR]
    bench = Bench(echoes=True)
    foreign = can.Message(arbitration_id=0x581, is_extended_id=False, data=bytes.fromhex("6060600000000000"))
    assert bench.tick(0.0, ENABLED_MESSAGE)[:2] == (OK, OK)
    assert bench.tick(0.5, foreign, ENABLED_MESSAGE) == (LOST, LOST, ["080#", "201#02000000", "000#0201"])
