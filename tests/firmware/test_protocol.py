"""docs/protocols/serial-dac.md, statement by statement, against every device that claims to speak it.

Black box: a host that knows the page alone, and the device's log of what its output stage did.
"""

import struct
import time
from pathlib import Path

import pytest

from tests.firmware.citations import PAGE, cites, statements
from tests.firmware.devices import Device, currents
from tests.polling import wait_until
from tests.sim_hw.boards import Board, rows
from tests.sim_hw.host import (
    AMPLIFIER_FAULT,
    BAD_FRAME,
    ENABLED,
    ENCODER_FAULT,
    EXTERNAL_STOP,
    REJECTED,
    UNCONFIGURED,
    WATCHDOG,
    Hello,
    Host,
    crc,
    stuffed,
    unstuffed,
)

LONG_MS = 2000
"""A watchdog time that a slow machine does not meet by chance."""


@pytest.fixture
def hello(host: Host) -> Hello:
    return begin(host)


def begin(host: Host, watchdog_ms: int = LONG_MS) -> Hello:
    """A session of which the output is off, without fault."""
    hello = host.hello()
    assert host.configure(watchdog_ms) == watchdog_ms
    host.command(middle(hello), 0)
    assert host.sample().status == 0
    return hello


def middle(hello: Hello) -> int:
    return 1 << (hello.dac_bits - 1)


def amperes(hello: Hello, code: int) -> float:
    return (code - middle(hello)) * hello.full_scale_ua * 1e-6 / middle(hello)


# Frames


def vectors() -> list[tuple[str, bytes, int, bytes]]:
    """The page's table of test vectors: what, payload, CRC, on the line."""
    found = []
    for statement in statements(PAGE.read_text()):
        cells = statement.split(" | ")
        if len(cells) == 4 and len(cells[2]) == 4 and cells[3].endswith(" 00"):
            found.append((cells[0], bytes.fromhex(cells[1]), int(cells[2], 16), bytes.fromhex(cells[3])))
    return found


@cites(
    "frame = COBS",
    "payload = type (u8)",
    "CRC = CRC-16",
    "polynomial 0x1021",
    "123456789 give 0x29B1",
    "the bytes are cut at every zero",
    "No piece can reach 254",
    "one byte longer than what went in",
    "Worked example",
    "payload | 03 00",
    "CRC of it is 0x485C",
    "pieces between zeros",
    "COBS: length + 1",
    "delimiter | 02 03",
)
def test_frames_are_made_as_on_the_page() -> None:
    """The host of these tests frames as the page's vectors do; what the devices make of them is below."""
    assert len(vectors()) == 16
    for _, payload, check, frame in vectors():
        assert crc(payload) == check
        assert stuffed(payload) == frame
        assert unstuffed(frame[:-1]) == payload
    assert crc(b"123456789") == 0x29B1
    assert stuffed(b"\x03\x00") == bytes.fromhex("02 03 03 5c 48 00")
    longest = stuffed(bytes(range(1, 33)))
    assert len(longest) == 36
    assert max(longest) < 254


@cites(
    "HELLO, version 1, nonce 0x1234",
    "HELLO reply: 14 bits",
    "CONFIGURE, 20 ms",
    "CONFIGURE, 2000 ms",
    "CONFIGURE reply, 20 ms",
    "CONFIGURE reply, refused",
    "SAMPLE, seq 0",
    "SAMPLE, seq 255",
    "SAMPLE reply: seq 7",
    "SAMPLE reply: seq 8",
    "COMMAND: seq 7, mid-scale of 14 bits, enable",
    "COMMAND: seq 7, mid-scale of 14 bits, disable",
    "COMMAND: seq 8, code 8875",
    "COMMAND: seq 9, code 0",
    "0x01 | HELLO | 4",
    "0x02 | CONFIGURE | 3",
    "0x03 | SAMPLE | 2",
    "0x04 | COMMAND | 5",
    "SAMPLE_INPUTS, seq 0",
    "SAMPLE_INPUTS reply: as the first above",
    "0x05 | SAMPLE_INPUTS | 2",
    "0x84 | SAMPLE_INPUTS reply | 13",
    "0x81 | HELLO reply | 20",
    "0x82 | CONFIGURE reply | 3",
    "0x83 | SAMPLE reply | 12",
    "Offsets are in the payload",
    "number of bytes on the line: payload + 4",
    "Integers are little-endian",
    "0x00 ends a frame and appears nowhere else",
)
def test_the_vectors_on_the_line(device: Device, tmp_path: Path) -> None:
    """The page's requests byte for byte, and replies of the page's form to them."""
    frames = {what: frame for what, _, _, frame in vectors()}
    with device.host(tmp_path) as (board, host):
        host.put(frames["HELLO, version 1, nonce 0x1234"])
        assert (host.receive() or b"")[:4] == bytes.fromhex("81 01 34 12")
        assert len(host.frame) == 24
        hello = host.hello(0xFFFF)
        for request, answer in (("CONFIGURE, 20 ms", "CONFIGURE reply, 20 ms"), ("CONFIGURE, 2000 ms", None)):
            host.put(frames[request])
            reply = host.receive()
            assert reply is not None
            assert host.frame == (frames[answer] if answer else stuffed(bytes.fromhex("82 d0 07")))
        host.send(bytes.fromhex("02 00 00"))
        assert host.receive() == bytes.fromhex("82 00 00")
        assert host.frame == frames["CONFIGURE reply, refused"]
        for seq in (0, 255):
            host.put(frames[f"SAMPLE, seq {seq}"])
            answer = host.reply()
            assert answer is not None
            assert (answer.seq, answer.command_seq) == (seq, 0)
            assert len(host.frame) == 16
            assert host.frame.index(0) == 15
        host.put(frames["SAMPLE_INPUTS, seq 0"])
        told = host.receive()
        assert told is not None
        assert told[:2] == bytes.fromhex("84 00")
        assert len(host.frame) == 17
        if hello.dac_bits == 14:
            host.put(frames["COMMAND: seq 7, mid-scale of 14 bits, enable"])
            assert host.sample().command_seq == 7
            host.put(frames["COMMAND: seq 8, code 8875 (+0.500 A at 6 A), enable"])
            assert host.sample().command_seq == 8
            host.put(frames["COMMAND: seq 9, code 0 (−6 A), enable"])
            host.put(frames["COMMAND: seq 7, mid-scale of 14 bits, disable"])
            last = host.sample()
            assert (last.command_seq, last.status) == (7, 0)
            assert currents(board.stop()) == pytest.approx([0.0, 683 * 6.0 / 8192, -6.0, 0.0])


BAD = [
    pytest.param(b"\x05\x03\xff\xac\x57\x00", id="CRC"),
    pytest.param(b"\x09\x03\xff\xac\x56\x00", id="COBS-past-the-end"),
    pytest.param(b"\x02\x03\xff\xac\x56\x00", id="COBS-short"),
    pytest.param(b"\xff\x03\xff\xac\x56\x00", id="COBS-piece-of-254"),
    pytest.param(b"\x01\x00", id="one-byte"),
    pytest.param(b"\x03\xff\xff\x00", id="CRC-of-nothing"),
    pytest.param(stuffed(b"\x06\x00"), id="type"),
    pytest.param(stuffed(b"\x83" + bytes(11)), id="a-reply's-type"),
    *(
        pytest.param(stuffed(payload), id=f"type-{payload[0]}-of-{len(payload)}")
        for payload in (
            b"\x01\x01\x34",
            b"\x01\x01\x34\x12\x00",
            b"\x02\x14",
            b"\x02\x14\x00\x00",
            b"\x03",
            b"\x03\x00\x00",
        )
    ),
    pytest.param(stuffed(b"\x04\x07\x00\x20"), id="type-4-of-4"),
    pytest.param(stuffed(b"\x04\x07\x00\x20\x01\x00"), id="type-4-of-6"),
    pytest.param(stuffed(bytes(range(1, 33))), id="longest"),
    pytest.param(stuffed(bytes(range(1, 34))), id="too-long"),
    pytest.param(b"\x01" * 3000 + b"\x00", id="far-too-long"),
]


@pytest.mark.parametrize("frame", BAD)
@cites(
    "A receiver collects bytes up to the next 0x00",
    "A frame that is longer, whose COBS leads past its end",
    "A decoder must check that each length byte",
    "| BAD_FRAME |",
)
def test_bad_frames_are_dropped_and_reported_once(host: Host, hello: Hello, frame: bytes) -> None:
    host.put(frame)
    assert host.sample().status == BAD_FRAME
    assert host.sample().status == 0


@cites("The next 0x00 always ends the damage")
def test_garbage_costs_one_good_frame_at_most(host: Host, hello: Hello) -> None:
    host.put(b"\x7f\x03\x55" * 30)
    lost, answered = host.ask(), host.ask()
    answer = host.reply()
    assert answer is not None
    assert (answer.seq, answer.status) == (answered, BAD_FRAME)
    assert answer.seq != lost


@cites("Zeros with nothing between them", "The host begins with one to flush")
def test_zeros_between_frames_mean_nothing(host: Host, hello: Hello) -> None:
    host.put(bytes(50))
    assert host.sample().status == 0


def test_a_frame_in_pieces(host: Host, hello: Hello) -> None:
    for byte in stuffed(b"\x03\x42"):
        host.put(bytes([byte]))
        time.sleep(0.002)
    answer = host.reply()
    assert answer is not None
    assert (answer.seq, answer.status) == (0x42, 0)


# Messages


@cites(
    "The board sends nothing unasked",
    "COMMAND has no reply of its own",
    "COMMAND: applied on receipt",
)
def test_silent_unless_asked(host: Host, hello: Hello) -> None:
    host.command(middle(hello), 0)
    assert host.receive(0.1) is None
    assert host.sample().command_seq == host.seq - 1


@cites(
    "It answers a HELLO of any version",
    "nonce | copied from the HELLO",
    "version | protocol version of the board",
    "dac_bits | resolution",
    "full_scale_uA | µA",
    "counter_bits | width",
    "watchdog_min_ms, watchdog_max_ms",
    "serial_number | of the board",
    "firmware | high byte major",
    "HELLO begins a session",
)
def test_hello(host: Host) -> None:
    first = host.hello(nonce=0)
    assert (first.version, first.nonce) == (1, 0)
    for version, nonce in ((9, 0xFFFF), (0, 1), (255, 0x0100)):
        again = host.hello(nonce=nonce, version=version)
        assert (again.version, again.nonce) == (1, nonce)
    assert 8 <= first.dac_bits <= 16
    assert first.full_scale_ua > 0
    assert 16 <= first.counter_bits <= 32
    assert 1 <= first.watchdog_min_ms <= first.watchdog_max_ms
    assert first.serial_number > 0
    assert first.firmware >> 8 >= 1


@cites(
    "CONFIGURE sets the watchdog time",
    "Within the range and while the output is disabled",
    "Otherwise it replies 0",
    "off (0) | → on | accept, stay | reply, stay | in range: set, else 0",
)
def test_configure(host: Host) -> None:
    hello = host.hello()
    for wanted in (hello.watchdog_min_ms, hello.watchdog_max_ms, 20):
        assert host.configure(wanted) == wanted
    for wanted in (0, hello.watchdog_min_ms - 1, hello.watchdog_max_ms + 1, 0xFFFF):
        assert host.configure(wanted) == 0


@cites("keeps what was in force", "on (1) | apply, restart watchdog")
def test_a_refused_configure_changes_nothing(device: Device, tmp_path: Path) -> None:
    with device.host(tmp_path) as (board, host):
        hello = begin(host, 60)
        assert host.configure(hello.watchdog_max_ms + 1) == 0
        host.command(middle(hello), 1)
        assert host.configure(hello.watchdog_max_ms) == 0  # not while the output is on
        board.wait_for_event("DISABLE")
        off_after_ms = device.off_after_ms(board.stop())
    assert off_after_ms + 0.01 >= 60  # how late is another test's
    assert off_after_ms < hello.watchdog_max_ms


@cites(
    "SAMPLE: on receipt of the frame's delimiter",
    "seq | copied from the SAMPLE",
    "board_time_us | µs since power-up",
    "status | see below",
    "command_seq | seq of the last COMMAND that was accepted",
    "One servo period is one exchange",
    "host SAMPLE ──► compute",
    "board latch, reply at once",
    "sample-to-current latency ────────►",
)
def test_exchanges(board: Board, host: Host, hello: Hello) -> None:
    first = host.sample()
    for _ in range(300):
        proved = host.seq
        host.command(middle(hello), 1)
        answer = host.sample()
        assert (answer.status, answer.command_seq) == (ENABLED, proved)
    # An emulated board may lag behind and catch up; ahead of the time it never is.
    powered_us = (time.monotonic_ns() - board.started_ns) // 1000
    assert first.time_us < answer.time_us <= powered_us
    host.hello()


@cites("count | the counter, two's complement", "positive current accelerates towards higher counts")
def test_count_follows_the_current(device: Device, tmp_path: Path) -> None:
    for sign in (1, -1):
        folder = tmp_path / str(sign)
        folder.mkdir()
        with device.host(folder) as (_, host):
            hello = begin(host)
            width = 1 << hello.counter_bits
            first = host.sample().count % width
            host.command(middle(hello) + sign * (middle(hello) // 4), 1)

            def moved(host: Host = host, width: int = width, first: int = first) -> int:
                return (host.sample().count - first + width // 2) % width - width // 2

            wait_until(lambda moved=moved, sign=sign: sign * moved() > 5, "the shaft moves")
            host.command(middle(hello), 0)


@cites("the bits above are ignored by the host", "two's complement")
def test_count_wraps(device: Device, tmp_path: Path) -> None:
    if device.name == "avr-uno":
        pytest.skip("its counter begins at zero")
    with device.host(tmp_path, "{start: {counts_offset: -3}}") as (_, host):
        hello = begin(host)
        assert host.sample().count % (1 << hello.counter_bits) == (1 << hello.counter_bits) - 3


@cites(
    "The code is offset binary",
    "current = (code",
    "otherwise | accepts: output enabled at the code",
    "| ENABLED | output enabled and following",
    "A COMMAND is",
)
def test_codes_are_currents(device: Device, tmp_path: Path) -> None:
    with device.host(tmp_path) as (board, host):
        hello = begin(host)
        codes = [middle(hello), middle(hello) + 1, middle(hello) - 1, 2 * middle(hello) - 1, 0, middle(hello) + 100]
        for code in codes:
            host.sample()
            host.command(code, 1)
        assert host.sample().status == ENABLED
        host.command(0, 0)
        assert host.sample().status == 0
        expected = [amperes(hello, code) for code in codes]
        assert currents(board.stop()) == pytest.approx([*expected, 0.0])


@cites("Several COMMANDs may follow one SAMPLE", "The board does not check the seq of a COMMAND")
def test_several_commands(device: Device, tmp_path: Path) -> None:
    with device.host(tmp_path) as (board, host):
        hello = begin(host)
        host.sample()
        for step in (10, 20, 30):
            host.command(middle(hello) + step, 1)
        host.send(struct.pack("<BBHB", 0x04, 0xEE, middle(hello) + 40, 1))
        assert host.sample().command_seq == 0xEE
        host.command(middle(hello), 0)
        host.sample()
        expected = [amperes(hello, middle(hello) + step) for step in (0, 10, 20, 30, 40, 0)]
        assert currents(board.stop()) == pytest.approx(expected)


@pytest.mark.parametrize("wrong", ["code", "code-and-disable", "flag 2", "flag 7"])
@cites(
    "code above 2^dac_bits",
    "Refusing changes neither output nor watchdog nor command_seq",
    "Accepting clears REJECTED",
    "| REJECTED | the last COMMAND was refused",
)
def test_refused_commands(host: Host, hello: Hello, wrong: str) -> None:
    if wrong.startswith("code") and hello.dac_bits == 16:
        pytest.skip("every code is one of 16 bits")
    before = host.sample()
    host.command(middle(hello), 1)
    seq = host.seq
    assert host.sample().status == ENABLED
    code, flags = {
        "code": (2 * middle(hello), 1),
        "code-and-disable": (0xFFFF, 0),
        "flag 2": (middle(hello), 4),
        "flag 7": (middle(hello), 0x81),
    }[wrong]
    host.command(code, flags)
    after = host.sample()
    assert after.status == ENABLED | REJECTED
    assert after.command_seq == seq != before.command_seq
    host.command(middle(hello), 0)
    assert host.sample().status == 0


# Output, faults and states


@cites(
    "Until the first accepted CONFIGURE after power-up",
    "| UNCONFIGURED | no CONFIGURE accepted",
    "power-up (128) | refuse | accept, stay | reply, stay",
    "0 before the first",
    "at power-up (before anything else is initialised",
)
def test_power_up(device: Device, tmp_path: Path) -> None:
    with device.host(tmp_path) as (board, host):
        first = host.sample()
        assert (first.status, first.command_seq) == (UNCONFIGURED, 0)
        hello = host.hello()
        assert host.sample().status == UNCONFIGURED
        host.command(middle(hello) + 100, 1)
        refused = host.sample()
        assert (refused.status, refused.command_seq) == (UNCONFIGURED | REJECTED, 0)
        host.command(0, 0)
        accepted = host.sample()
        assert (accepted.status, accepted.command_seq) == (UNCONFIGURED, refused.seq)
        assert host.configure(0) == 0
        assert host.sample().status == UNCONFIGURED
        assert host.configure(20) == 20
        assert host.sample().status == 0
        log = board.stop()
    assert currents(log) == [0.0]
    assert rows(log, "ENABLE").size == 0


@cites(
    "by HELLO, by an accepted COMMAND with enable = 0, by the watchdog",
    "Nothing but an accepted COMMAND with enable = 1 enables it",
    "Disabled means: amplifier switched off",
    "enable = 0 | accepts: output disabled and at mid-scale whatever the code",
    "The board must disable the output, send the reply",
)
def test_what_switches_off(device: Device, tmp_path: Path) -> None:
    with device.host(tmp_path) as (board, host):
        hello = begin(host)
        code = middle(hello) + 200
        for switch_off in (lambda: host.hello(), lambda: host.command(0, 0)):
            host.sample()
            host.command(code, 1)
            assert host.sample().status == ENABLED
            switch_off()
            assert host.sample().status == 0
            assert host.configure(LONG_MS) == LONG_MS
            assert host.sample().status == 0
        log = board.stop()
    flowing = amperes(hello, code)
    assert currents(log) == pytest.approx([0.0, flowing, 0.0, flowing, 0.0])
    assert rows(log, "ENABLE").size == rows(log, "DISABLE").size == 2


@cites(
    "SAMPLE_INPUTS is a SAMPLE whose reply brings the inputs too",
    "HELD: the enable input, which a person holds, is closed",
    "A board without one never sets it",
    "or with while held and HELD clear | refuses",
    "Where that said while held, the end of HELD disables it too",
)
def test_the_enable_input(device: Device, tmp_path: Path) -> None:
    """Released while the output is on: off by itself, and held again nothing goes on without a COMMAND with enable 0."""
    script = "faults: [{kind: enable_released, at_s: 0.3, from: enabled, duration_s: 0.2}]"
    with device.host(tmp_path, script) as (board, host):
        hello = host.hello()
        assert host.configure(10_000) == 10_000
        assert host.inputs()[1] == 0  # nobody has looked at it yet
        host.command(middle(hello), 0)
        assert host.inputs()[1] == 1
        host.command(middle(hello) + 100, 3)
        before, held = host.inputs()
        assert (before.status, held) == (ENABLED, 1)
        wait_until(lambda: host.inputs()[1] == 0, "the release")
        wait_until(lambda: host.sample().status & ENABLED == 0, "the output to go off")
        board.wait_for_event("DISABLE")
        time.sleep(0.4)  # it is held again by now
        host.command(middle(hello) + 100, 3)
        after, held = host.inputs()
        assert (after.status, held) == (REJECTED, 0)
        host.command(middle(hello), 0)
        assert host.inputs()[1] == 1
        host.command(middle(hello) + 100, 3)
        assert host.inputs()[0].status == ENABLED
        host.command(middle(hello), 0)
        host.sample()
        log = board.stop()
    assert rows(log, "ENABLE").size == 2


@cites(
    "| WATCHDOG | latched: no accepted COMMAND",
    "It runs while the output is enabled; every accepted COMMAND",
    "it acts within 1 ms of its time",
    "The watchdog must not depend on the code that receives frames",
    "latched (2, 4, 8, 64) | refuse",
    "SAMPLE is answered in every state",
    "latched faults stay latched",
)
@pytest.mark.realtime
def test_nothing_else_keeps_the_output_alive(device: Device, tmp_path: Path) -> None:
    """SAMPLEs, refused COMMANDs and a streak of bad frames do not restart the watchdog; what it did stays latched."""
    watchdog_ms = 150
    with device.host(tmp_path) as (board, host):
        hello = begin(host, watchdog_ms)
        host.sample()
        host.command(middle(hello) + 50, 1)
        seq = host.seq

        def trip() -> bool:
            host.put(b"\x05\x03\xff\xac\x57\x00" + stuffed(bytes([4, 1, 0, 0, 4])))
            host.command(0xFFFF if hello.dac_bits < 16 else 0, 5)
            return bool(host.sample().status & WATCHDOG)

        wait_until(trip, "the watchdog's trip")
        host.sample()
        assert host.sample().status == WATCHDOG | REJECTED
        host.hello()
        assert host.configure(LONG_MS) == LONG_MS
        host.command(middle(hello), 1)
        refused = host.sample()
        assert (refused.status, refused.command_seq) == (WATCHDOG | REJECTED, seq)
        host.command(middle(hello), 0)
        assert host.sample().status == 0
        log = board.stop()
    assert currents(log) == pytest.approx([0.0, amperes(hello, middle(hello) + 50), 0.0])
    assert watchdog_ms <= device.off_after_ms(log) + 0.01 <= watchdog_ms + 1.01


@cites("the watchdog time stays", "every accepted COMMAND with enable = 1, and nothing else, restarts it")
@pytest.mark.realtime
def test_accepted_commands_restart_the_watchdog(device: Device, tmp_path: Path) -> None:
    watchdog_ms = 400
    with device.host(tmp_path) as (board, host):
        hello = begin(host, watchdog_ms)
        host.hello()  # does not change the time
        end = time.monotonic() + 2.0 * watchdog_ms * 1e-3
        while time.monotonic() < end:
            host.sample()
            host.command(middle(hello), 1)
            time.sleep(0.01)
        assert host.sample().status == ENABLED
        board.wait_for_event("DISABLE")
        log = board.stop()
    assert watchdog_ms <= device.off_after_ms(log) + 0.01 <= watchdog_ms + 1.01


@cites("Power-up value: 20 ms")
def test_watchdog_at_power_up(device: Device, tmp_path: Path) -> None:
    """A board that is UNCONFIGURED refuses to enable, so its power-up value shows in the range alone."""
    with device.host(tmp_path) as (_, host):
        hello = host.hello()
        assert hello.watchdog_min_ms <= 20 <= hello.watchdog_max_ms


@pytest.mark.parametrize(
    ("kind", "bit"),
    [("encoder_fault", ENCODER_FAULT), ("amplifier_fault", AMPLIFIER_FAULT), ("external_stop", EXTERNAL_STOP)],
)
@cites(
    "| ENCODER_FAULT | latched",
    "| AMPLIFIER_FAULT | latched",
    "| EXTERNAL_STOP | the external stop input is open",
    "by any bit of ENCODER_FAULT, AMPLIFIER_FAULT and EXTERNAL_STOP",
    "enable = 1 while a fault is latched",
    "latched faults whose cause is gone are cleared",
)
def test_faults_of_the_board(device: Device, tmp_path: Path, kind: str, bit: int) -> None:
    script = f"faults: [{{kind: {kind}, at_s: 0.05, from: enabled, duration_s: 0.6}}]"
    with device.host(tmp_path, script) as (board, host):
        hello = begin(host)
        host.sample()
        host.command(middle(hello) + 77, 1)
        wait_until(lambda: host.sample().status == bit, "the fault")
        host.command(middle(hello), 0)
        assert host.sample().status == bit  # its cause is still there
        host.command(middle(hello), 1)
        assert host.sample().status == bit | REJECTED

        def cleared() -> bool:
            host.command(middle(hello), 0)
            return host.sample().status == 0

        wait_until(cleared, "the cause to go")
        host.command(middle(hello) + 77, 1)
        assert host.sample().status == ENABLED
        host.command(middle(hello), 0)
        host.sample()
        log = board.stop()
    flowing = amperes(hello, middle(hello) + 77)
    assert currents(log) == pytest.approx([0.0, flowing, 0.0, flowing, 0.0])


@cites("may not go on as if nothing had happened", "while the processor is in reset, by hardware pull")
def test_reboot(device: Device, tmp_path: Path) -> None:
    script = "faults: [{kind: reboot, at_s: 0.05, from: enabled, off_s: 0.05}]"
    with device.host(tmp_path, script) as (board, host):
        hello = begin(host)
        host.sample()
        host.command(middle(hello) + 77, 1)
        board.wait_for_event("REBOOT", 2)
        first = host.sample()
        assert (first.status, first.command_seq) == (UNCONFIGURED, 0)
        host.command(middle(hello) + 77, 1)
        assert host.sample().status == UNCONFIGURED | REJECTED
        log = board.stop()
    assert currents(log) == pytest.approx([0.0, amperes(hello, middle(hello) + 77), 0.0])
    off, reboot = rows(log, "DISABLE")["time_ns"][0], rows(log, "REBOOT")["time_ns"][0]
    assert off <= reboot


def test_several_hosts_one_after_the_other(device: Device, tmp_path: Path) -> None:
    """A host that goes leaves the watchdog to do its work, and the board as it was to the next."""
    with device.running(tmp_path) as board:
        for number in (1, 2):
            host = Host(board.link)
            hello = begin(host, 100)
            host.sample()
            host.command(middle(hello) + 100, 1)
            host.sample()
            host.close()
            board.wait_for_event("DISABLE", number)
        host = Host(board.link)
        assert host.sample().status == WATCHDOG
        host.close()
