"""The compiled exchange, byte for byte: one line a frame."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest

from drivers.canopen import layout as w
from drivers.interface import (
    DEVICE_FAULT,
    ERROR,
    LOST,
    MISSED,
    OK,
    X_COUNTS,
    X_CURRENT_MEASURED,
    X_DEVICE_CODE,
    X_STATUS,
)
from tests.drivers.canopen.wire import Wire
from tests.polling import PATIENCE_S

DISABLED = "< 181#5002D204000000FE"  # statusword 0x0250, position 1234, actual -512
READY = "< 181#3102D204000000FE"
ON = "< 181#3302D204000000FE"
ENABLED = "< 181#3702D204000000FE"
FAULT = "< 181#1802D204000000FE"


@pytest.fixture
def wire() -> Iterator[Wire]:
    with Wire() as made:
        yield made


def enable(wire: Wire) -> None:
    for sample, command in ((DISABLED, "0600"), (READY, "0700"), (ON, "0F00"), (ENABLED, "0F00")):
        assert wire.read("> 080#", sample) == OK
        assert wire.write(0.0, 1, f"> 201#{command}0000") == OK


def test_enabling_takes_one_transition_a_tick_at_zero_current(wire: Wire) -> None:
    exchanges = [
        (DISABLED, 0, "> 201#06000000"),
        (READY, 0, "> 201#07000000"),
        (ON, 0, "> 201#0F000000"),
        (ENABLED, 1, "> 201#0F00FA00"),  # 0.5 A / 0.002 A = 250
    ]
    for sample, status, command in exchanges:
        assert wire.read("> 080#", sample) == OK
        assert (wire.x[X_COUNTS], wire.x[X_STATUS]) == (1234, status)
        assert wire.xf[X_CURRENT_MEASURED] == pytest.approx(-5.12)
        assert wire.write(0.5, 1, command) == OK
    assert wire.nothing_sent()


@pytest.mark.parametrize(
    ("current", "command"),
    [
        (-0.5, "> 201#0F0006FF"),
        (0.0029, "> 201#0F000100"),
        (1e3, "> 201#0F00FF7F"),
        (-1e3, "> 201#0F000180"),
    ],
)
def test_command_is_the_nearest_step_and_never_wraps(wire: Wire, current: float, command: str) -> None:
    enable(wire)
    assert wire.read("> 080#", ENABLED) == OK
    assert wire.write(current, 1, command) == OK


def test_disabling_is_disable_voltage_at_zero(wire: Wire) -> None:
    enable(wire)
    assert wire.read("> 080#", ENABLED) == OK
    assert wire.write(0.5, 0, "> 201#00000000") == OK


def test_position_goes_on_past_32_bits(wire: Wire) -> None:
    counts = []
    for position in ("FEFFFF7F", "FFFFFF7F", "00000080", "02000080", "FFFFFF7F", "00000000", "00000080"):
        assert wire.read("> 080#", f"< 181#5002{position}0000") == OK
        counts.append(int(wire.x[X_COUNTS]))
    base = 2**31
    assert counts == [base - 2, base - 1, base, base + 2, base - 1, 0, -base]


def test_no_answer_is_missed_and_keeps_what_was_there(wire: Wire) -> None:
    enable(wire)
    assert wire.read("> 080#", period_ns=4e7) == MISSED
    assert (wire.x[X_COUNTS], wire.x[X_STATUS]) == (1234, 1)
    assert wire.write(0.5, 1, "> 201#0F00FA00") == OK


def test_late_answer_is_thrown_away(wire: Wire) -> None:
    assert wire.read("> 080#", period_ns=2e7) == MISSED
    assert wire.write(0.0, 0, "> 201#00000000", "< 181#5002010000000000") == OK
    assert wire.read("> 080#", "< 181#5002020000000000") == OK
    assert (wire.x[X_COUNTS], wire.s[w.STALE]) == (2, 1)


def test_answer_later_than_the_next_tick_is_thrown_away_before_a_sync(wire: Wire) -> None:
    assert wire.read("> 080#", period_ns=2e7) == MISSED
    assert wire.read("< 181#5002010000000000", "> 080#", "< 181#5002020000000000") == OK
    assert wire.x[X_COUNTS] == 2
    assert wire.read("> 080#", "< 181#5002030000000000") == OK
    assert (wire.x[X_COUNTS], wire.s[w.STALE]) == (3, 1)


def test_after_a_lost_answer_one_tick_listens(wire: Wire) -> None:
    assert wire.read("> 080#", period_ns=2e7) == MISSED
    assert wire.read(period_ns=2e7) == MISSED
    assert wire.nothing_sent()
    assert wire.read("> 080#", "< 181#5002020000000000") == OK
    assert wire.x[X_COUNTS] == 2


def test_a_drive_that_is_always_a_period_late_is_never_believed(wire: Wire) -> None:
    before = wire.x[X_COUNTS]
    assert wire.read("> 080#", period_ns=2e7) == MISSED
    for late in ("< 181#5002010000000000", "< 181#5002020000000000", "< 181#5002030000000000"):
        assert wire.read(late, "> 080#", period_ns=2e7) == MISSED
    assert wire.x[X_COUNTS] == before


def test_other_frames_are_passed_over_while_waiting(wire: Wire) -> None:
    assert wire.read("> 080#", "< 581#4B41600050020000", "< 702#05", "< 182#0000000000000000", DISABLED) == OK
    assert wire.x[X_COUNTS] == 1234


def test_sign_of_life_comes_with_the_command_every_quarter_of_the_watchdog() -> None:
    with Wire(guard_ms=100_000) as wire:
        period = 5e10
        assert wire.read("> 080#", DISABLED) == OK
        assert wire.write(0.0, 0, "> 201#00000000", "> 701#R", period_ns=period) == OK
        assert wire.read("< 701#05", "> 080#", DISABLED) == OK
        assert wire.write(0.0, 0, "> 201#00000000", period_ns=period) == OK
        assert wire.nothing_sent()
        wire.s[w.GUARD_SENT_NS] -= 60 * 10**9  # a minute passes
        assert wire.read("> 080#", DISABLED) == OK
        assert wire.write(0.0, 0, "> 201#00000000", "> 701#R", period_ns=period) == OK
        assert wire.read("< 701#85", "> 080#", DISABLED) == OK
        assert (wire.s[w.GUARD_OPEN], wire.s[w.GUARD_TOGGLE]) == (0, 0)


@pytest.mark.parametrize("reply", [(), ("< 701#05",)])
def test_guarding_without_answers_or_with_a_stuck_toggle_bit_is_lost(reply: tuple[str, ...]) -> None:
    with Wire(guard_ms=1) as wire:
        written = [wire.write(0.0, 0, "> 201#00000000", "> 701#R", period_ns=1e9)]
        while written[-1] == OK and len(written) < 8:
            assert wire.read(*reply, "> 080#", DISABLED) == OK
            written.append(wire.write(0.0, 0, "> 201#00000000", period_ns=1e9))
            wire.nothing_sent()
        assert written == [OK] * (5 if reply else 4) + [LOST]
        assert wire.why == "node 1 left 4 guarding requests in a row without a valid answer"


def test_emergency_and_fault_are_reported_with_the_code(wire: Wire) -> None:
    enable(wire)
    assert wire.read("> 080#", "< 081#1023020000000000", FAULT) == DEVICE_FAULT
    assert (wire.x[X_DEVICE_CODE], wire.x[X_STATUS]) == (0x2310, 0)
    assert wire.why == "node 1: EMCY 0x2310 (continuous over-current); statusword 0x0218, Fault"
    assert wire.write(0.0, 1, "> 201#02000000") == OK  # quick stop
    assert wire.read("> 080#", FAULT) == DEVICE_FAULT
    assert wire.write(0.0, 0, "> 201#00000000") == OK
    assert wire.read("> 080#", FAULT) == OK


def test_fault_without_an_emergency_asks_the_drive_for_its_code(wire: Wire) -> None:
    enable(wire)
    assert wire.read("> 080#", FAULT) == DEVICE_FAULT
    assert wire.x[X_DEVICE_CODE] == 0x1000
    assert wire.write(0.0, 1, "> 201#02000000", "> 601#403F600000000000") == OK
    assert wire.read("> 080#", "< 581#4B3F600010420000", FAULT) == DEVICE_FAULT
    assert wire.x[X_DEVICE_CODE] == 0x4210
    assert wire.why == "node 1: error code 0x603f 0x4210 (temperature of the device too high); statusword 0x0218, Fault"


def test_fault_is_reset_by_one_edge_when_the_amplifier_is_asked_for_again(wire: Wire) -> None:
    assert wire.read("> 080#", "< 081#3081110000000000", FAULT) == DEVICE_FAULT
    for sample, enabled, command in (
        (FAULT, 0, "00"),
        (FAULT, 1, "80"),
        (FAULT, 1, "80"),
        (DISABLED, 1, "06"),
        (READY, 1, "07"),
    ):
        assert wire.read("> 080#", sample) == OK
        assert wire.write(0.0, enabled, f"> 201#{command}000000") == OK
        if wire.s[w.RESETTING_NS]:
            wire.s[w.RESETTING_NS] += 10**12  # however slow this machine is, its time is not over


def test_fault_that_cannot_be_reset_is_reported_again(wire: Wire) -> None:
    assert wire.read("> 080#", "< 081#3081110000000000", FAULT) == DEVICE_FAULT
    assert wire.write(0.0, 0, "> 201#00000000") == OK
    assert wire.read("> 080#", FAULT) == OK
    assert wire.write(0.0, 1, "> 201#80000000") == OK
    time.sleep(0.21)
    assert wire.read("> 080#", FAULT) == DEVICE_FAULT
    assert wire.x[X_DEVICE_CODE] == 0x8130


def test_dropping_out_of_operation_enabled_takes_the_status_bit_away(wire: Wire) -> None:
    enable(wire)
    assert wire.read("> 080#", ON) == OK
    assert wire.x[X_STATUS] == 0
    assert wire.write(0.5, 1, "> 201#0F000000") == OK


@pytest.mark.parametrize(
    ("heard", "why"),
    [
        ("< 701#00", "node 1 rebooted: it sent its boot-up message and has lost its settings"),
        ("< 701#7F", "node 1 is pre-operational, no longer operational"),
        ("< 701#84", "node 1 is stopped, no longer operational"),
        ("< 20000040#0000000000000000", "bus-off: the CAN controller has left the bus after too many errors"),
    ],
)
def test_lost_for_good(wire: Wire, heard: str, why: str) -> None:
    enable(wire)
    assert wire.read("> 080#", heard) == LOST
    assert wire.why is not None
    assert wire.why.startswith(why)
    assert wire.write(0.5, 1, "> 201#02000000") == LOST
    assert wire.read() == LOST
    assert wire.write(0.0, 0, "> 201#00000000") == LOST
    assert wire.nothing_sent()


def test_closed_connection_is_lost(wire: Wire) -> None:
    wire.drive.close()
    assert wire.read() == LOST
    assert wire.write(0.5, 1) == LOST
    assert wire.why == "the other side of the CAN connection has closed it"


def test_broken_descriptor_is_lost(wire: Wire) -> None:
    wire.s[w.DESCRIPTOR] = 999_999
    assert wire.read() == LOST
    assert wire.why == "CAN interface: Bad file descriptor"


def test_full_queue_is_missed_and_passes(wire: Wire) -> None:
    sent = 0
    while wire.write(0.0, 0) == OK:
        sent += 1
    assert sent > 0
    assert wire.write(0.0, 0) == MISSED
    assert wire.read(period_ns=2e7) == MISSED
    for _ in range(sent):
        wire.drive.recv(64)
    assert wire.write(0.0, 0, "> 201#00000000") == OK


@pytest.mark.parametrize(
    ("heard", "who"),
    [
        ("080#", "SYNC (0x080)"),
        ("000#0101", "NMT (0x000)"),
        ("201#0F000000", "RPDO 1 to node 1 (0x201)"),
        ("701#R", "a guarding request to node 1 (0x701)"),
    ],
)
def test_another_master_is_an_error_every_time_it_speaks(wire: Wire, heard: str, who: str) -> None:
    enable(wire)
    for sent in (["> 080#"], []):  # after a SYNC without an answer the next tick listens first
        assert wire.read(*sent, f"< {heard}") == ERROR
        assert wire.why == f"another master is on the bus: it sent {who}"
        assert wire.write(0.0, 1, "> 201#02000000") == OK


def test_sample_of_the_wrong_length_is_an_error(wire: Wire) -> None:
    assert wire.read("> 080#", "< 181#5002D204") == ERROR
    assert wire.why is not None
    assert wire.why.startswith("TPDO 1 of node 1 came with 4 bytes, 8 are mapped")


@pytest.mark.parametrize(
    ("sample", "word", "why"),
    [
        (DISABLED, "06", "Switch on disabled → Ready to switch on: statusword 0x0250, waited 0.5 s"),
        (
            "< 181#2102000000000000",
            "07",
            "Ready to switch on → Switched on: statusword 0x0221, waited 0.5 s; bit 4 is 0",
        ),
        (ON, "0F", "Switched on → Operation enabled: statusword 0x0233, waited 0.5 s"),
    ],
)
def test_transition_that_does_not_come_is_named(wire: Wire, sample: str, word: str, why: str) -> None:
    assert wire.read("> 080#", sample) == OK
    assert wire.write(0.0, 1, f"> 201#{word}000000") == OK
    time.sleep(0.51)
    assert wire.read("> 080#", sample) == OK
    assert wire.write(0.0, 1, "> 201#02000000") == ERROR
    assert wire.why is not None
    assert wire.why.startswith(why)


def test_babbling_bus_does_not_hold_the_loop(wire: Wire) -> None:
    """Frames that arrive faster than they are taken in end with the time-out, not never."""
    begin = time.monotonic()
    assert wire.read("> 080#", *["< 702#05"] * 200, period_ns=4e7) == MISSED
    assert time.monotonic() - begin < PATIENCE_S


@pytest.fixture
def echoing() -> Iterator[Wire]:
    with Wire(read_back=True) as made:
        enable(made)
        yield made


def tick(wire: Wire, demand: str | None, current: float, sent: str, *more: str, sample: str = ENABLED) -> int:
    """One tick: the demand of the SYNC before has come in meanwhile; what the write returns."""
    before = [f"< 281#{demand}"] if demand is not None else []
    assert wire.read(*before, "> 080#", sample) == OK
    return wire.write(current, 1, f"> 201#{sent}", *more)


def test_a_demand_that_follows_one_sample_late_is_right(echoing: Wire) -> None:
    exchanges = [
        ("0000", 0.5, "0F00FA00"),
        ("0000", 0.2, "0F006400"),
        ("FA00", -0.2, "0F009CFF"),
        ("6400", 0.0, "0F000000"),
    ]
    for demand, current, sent in exchanges:
        assert tick(echoing, demand, current, sent) == OK
    assert echoing.s[w.UNHEARD] == 0


def test_a_drive_that_takes_no_commands_is_stopped_by_nmt(echoing: Wire) -> None:
    assert tick(echoing, "0000", 0.5, "0F00FA00") == OK
    results = [tick(echoing, "FA00", 0.4 - 0.1 * n, f"0F00{200 - 50 * n:02X}00") for n in range(4)]
    assert results == [OK, OK, OK, OK]  # 0.5 A may still be a command that was taken up late
    assert tick(echoing, "FA00", 0.0, "0F000000") == MISSED
    assert tick(echoing, "FA00", 0.0, "02000000", "> 000#0201") == LOST
    assert echoing.why == (
        "node 1 does not follow its commands (RPDO 1, 0x201): in 3 samples in a row its demand was not one "
        "of the latest, last 0.5 A with 0 A commanded; the node was stopped by NMT"
    )
    assert echoing.read() == LOST
    assert echoing.write(0.0, 0, "> 201#00000000") == LOST
    assert echoing.nothing_sent()


def test_lost_commands_show_only_when_they_change(echoing: Wire) -> None:
    for _ in range(20):
        assert tick(echoing, "0000", 0.0, "0F000000") == OK


def test_one_lost_command_is_tolerated(echoing: Wire) -> None:
    demands = ["0000", "0000", "6400", "6400", "C800", "FA00"]  # the third command got lost
    commands = [(0.2, "6400"), (0.3, "9600"), (0.4, "C800"), (0.5, "FA00"), (0.5, "FA00"), (0.5, "FA00")]
    for demand, (current, sent) in zip(demands, commands, strict=True):
        assert tick(echoing, demand, current, f"0F00{sent}") == OK


def test_a_demand_that_stays_out_is_no_proof_either(echoing: Wire) -> None:
    assert tick(echoing, "0000", 0.1, "0F003200") == OK
    assert tick(echoing, None, 0.1, "0F003200") == OK
    assert tick(echoing, None, 0.1, "0F003200") == MISSED
    assert tick(echoing, None, 0.1, "02000000", "> 000#0201") == LOST
    assert echoing.why == "node 1 sent no TPDO 2 (0x281) with 3 samples in a row; the node was stopped by NMT"


def test_a_demand_at_a_limit_may_be_less_but_not_more(echoing: Wire) -> None:
    limited = "< 181#370AD204000000FE"  # bit 11: internal limit active
    assert tick(echoing, "0000", 0.5, "0F00FA00") == OK
    for _ in range(5):
        assert tick(echoing, "6400", 0.5, "0F00FA00", sample=limited) == OK
    for _ in range(2):
        tick(echoing, "2C01", 0.5, "0F00FA00", sample=limited)
    assert tick(echoing, "2C01", 0.5, "02000000", "> 000#0201", sample=limited) == LOST


def test_outside_operation_enabled_the_demand_does_not_count() -> None:
    with Wire(read_back=True) as wire:
        for _ in range(6):
            assert wire.read("< 281#FA00", "> 080#", DISABLED) == OK
            assert wire.write(0.0, 0, "> 201#00000000") == OK


def test_a_second_command_in_a_tick_asks_no_second_time(echoing: Wire) -> None:
    assert tick(echoing, "0000", 0.1, "0F003200") == OK
    for _ in range(3):
        assert echoing.write(0.1, 1, "> 201#0F003200") == OK


def test_a_demand_of_the_wrong_length_is_an_error(echoing: Wire) -> None:
    assert echoing.read("< 281#FA") == ERROR
    assert echoing.why is not None
    assert echoing.why.startswith("TPDO 2 of node 1 came with 1 bytes, 2 are mapped")
