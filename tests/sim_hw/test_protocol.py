"""The board as a host sees it, byte by byte: handshake, output, latched states, watchdog, frames that are not right."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.polling import wait_until
from tests.sim_hw.boards import Board, rows, running_board
from tests.sim_hw.host import (
    BAD_FRAME,
    ENABLED,
    MIDDLE,
    REJECTED,
    UNCONFIGURED,
    WATCHDOG,
    Host,
    crc,
    stuffed,
    unstuffed,
)

VECTORS = [
    ("01013412", "0701013412663e00"),
    ("021400", "030214034b6d00"),
    ("03ff", "0503ffac5600"),
    ("83 07 feffffff 40420f00 01 06", "0a8307feffffff40420f050106da0500"),
    ("0409000001", "0304090104015c7b00"),
]
"""Of the protocol document: payload, frame."""


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Board]:
    with running_board(tmp_path_factory.mktemp("board")) as board:
        yield board


@pytest.fixture
def host(board: Board) -> Iterator[Host]:
    host = Host(board.link)
    yield host
    host.close()


@pytest.mark.parametrize(("payload", "frame"), VECTORS)
def test_this_host_frames_as_the_document_does(payload: str, frame: str) -> None:
    data = bytes.fromhex(frame)
    assert stuffed(bytes.fromhex(payload)) == data
    assert unstuffed(data[:-1]) == bytes.fromhex(payload)
    assert crc(b"123456789") == 0x29B1


def test_hello_and_configure(host: Host) -> None:
    hello = host.hello(nonce=0)
    assert (hello.version, hello.nonce, hello.dac_bits, hello.full_scale_ua) == (1, 0, 14, 6_000_000)
    assert hello.counter_bits == 32
    assert host.hello(nonce=0xFFFF, version=9).nonce == 0xFFFF
    assert 1 <= hello.watchdog_min_ms <= 20 <= hello.watchdog_max_ms
    assert host.configure(hello.watchdog_max_ms + 1) == 0
    assert host.configure(hello.watchdog_min_ms - 1) == 0
    assert host.configure(hello.watchdog_max_ms) == hello.watchdog_max_ms


def test_one_exchange(host: Host) -> None:
    host.begin(10_000)
    before_ns = time.monotonic_ns()
    first = host.sample()
    assert first.status == 0
    host.command(MIDDLE, 1)
    second = host.sample()
    assert second.status == ENABLED
    assert second.command_seq == first.seq
    assert 0 < second.time_us - first.time_us <= (time.monotonic_ns() - before_ns) // 1000 + 1
    assert host.configure(20) == 0  # not while the output is on
    host.hello()
    assert host.sample().status == 0


@pytest.mark.parametrize(("code", "flags"), [(1 << 14, 1), (0xFFFF, 0), (MIDDLE, 2), (MIDDLE, 0x80)])
def test_refused_commands(host: Host, code: int, flags: int) -> None:
    host.begin()
    before = host.sample()
    host.command(code, flags)
    after = host.sample()
    assert after.status == REJECTED
    assert after.command_seq == before.command_seq
    host.command(MIDDLE, 0)
    assert host.sample().status == 0


def test_watchdog_is_latched_until_disabled(host: Host) -> None:
    host.begin(20)
    host.sample()
    host.command(MIDDLE, 1)
    wait_until(lambda: host.sample().status == WATCHDOG, "the watchdog's trip")
    host.command(MIDDLE, 1)
    assert host.sample().status == WATCHDOG | REJECTED
    host.command(MIDDLE, 0)
    assert host.sample().status == 0


BAD = [
    b"\x05\x03\xff\xac\x57\x00",  # CRC
    b"\x09\x03\xff\xac\x56\x00",  # COBS leads past the end
    b"\x01\x00",
    stuffed(b"\x05\x00"),  # no such type
    stuffed(b"\x03\x00\x00"),  # wrong length for its type
    stuffed(bytes(range(33))),  # too long
    b"\x01" * 3000 + b"\x00",
]


@pytest.mark.parametrize("frame", BAD)
def test_bad_frames_are_dropped_and_reported_once(host: Host, frame: bytes) -> None:
    host.begin()
    host.put(frame)
    assert host.sample().status == BAD_FRAME
    assert host.sample().status == 0


def test_zeros_between_frames_mean_nothing(host: Host) -> None:
    host.begin()
    host.put(bytes(50))
    assert host.sample().status == 0


def test_a_frame_in_pieces(host: Host) -> None:
    host.begin()
    for byte in stuffed(b"\x03\x42"):
        host.put(bytes([byte]))
        time.sleep(0.002)
    answer = host.reply()
    assert answer is not None
    assert (answer.seq, answer.status) == (0x42, 0)


def test_several_hosts_one_after_the_other(tmp_path: Path) -> None:
    with running_board(tmp_path) as board:
        for number in (1, 2):
            host = Host(board.link)
            host.begin(30)
            host.sample()
            host.command(MIDDLE + 100, 1)
            host.close()
            board.wait_for_event("WATCHDOG", number)
        host = Host(board.link)
        assert host.hello().version == 1
        assert host.sample().status == WATCHDOG
        host.close()
        used = sum(_cpu_s(board.process.pid))
        time.sleep(1.0)  # a port that nobody has open
        assert sum(_cpu_s(board.process.pid)) - used < 0.3
        log = board.stop()
    assert not board.link.is_symlink()
    trips = rows(log, "WATCHDOG")
    assert len(trips) == 2
    for trip in trips:
        commands = rows(log[log["time_ns"] < trip["time_ns"]], "COMMAND")
        assert trip["time_ns"] - commands["time_ns"][-1] == 30_000_000


def test_begins_unconfigured(tmp_path: Path) -> None:
    with running_board(tmp_path) as board:
        host = Host(board.link)
        host.hello()
        assert host.sample().status == UNCONFIGURED
        host.command(MIDDLE, 1)
        assert host.sample().status == UNCONFIGURED | REJECTED
        host.close()


def _cpu_s(pid: int) -> tuple[float, float]:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return int(fields[11]) / 100, int(fields[12]) / 100
