"""The port itself: raw, alone, without the delays of the kernel and of FTDI; refusals in words."""

import fcntl
import logging
import os
import select
import struct
import termios
from pathlib import Path
from typing import Any

import pytest

from drivers import DriverError
from drivers.serial_dac import port
from tests.drivers.serial.expected_exchange import line
from tests.polling import PATIENCE_S


def arrived(descriptor: int, size: int) -> bytes:
    """So many bytes: the kernel hands a terminal's bytes on when it comes to it, and in pieces."""
    got = b""
    while len(got) < size:
        assert select.select([descriptor], [], [], PATIENCE_S)[0], f"{len(got)} of {size} bytes arrived"
        got += os.read(descriptor, 512)
    return got


def test_every_byte_passes_both_ways_unchanged() -> None:
    every = bytes(range(256))
    with line() as (master, path):
        opened = port.open_port(path, 921_600)
        os.write(opened.fileno(), every)
        assert arrived(master, len(every)) == every
        os.write(master, every)
        assert arrived(opened.fileno(), len(every)) == every
        opened.close()


def test_an_idle_line_and_a_dead_one_are_told_apart() -> None:
    with line() as (master, path):
        opened = port.open_port(path, 921_600)
        with pytest.raises(BlockingIOError):
            os.read(opened.fileno(), 1)
        os.dup2(os.open(os.devnull, os.O_RDWR), master)
        assert select.select([opened.fileno()], [], [], PATIENCE_S)[0]
        assert os.read(opened.fileno(), 1) == b""
        opened.close()


def test_the_port_is_ours_alone() -> None:
    with line() as (_, path):
        opened = port.open_port(path, 921_600)
        with pytest.raises(DriverError, match="in use by another process"):
            port.open_port(path, 921_600)
        opened.close()
        port.open_port(path, 921_600).close()


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("/dev/ttyNONE9", "driver.port = '/dev/ttyNONE9', driver.baud = 115200: no such device; is it plugged in?"),
        ("/dev/null", "driver.port = '/dev/null', driver.baud = 115200: Could not configure port"),
    ],
)
def test_what_is_no_port_is_named(path: str, said: str) -> None:
    with pytest.raises(DriverError) as caught:
        port.open_port(path, 115_200)
    assert str(caught.value).startswith(said)


def test_a_pseudo_terminal_makes_no_noise(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.DEBUG), line() as (_, path):
        port.open_port(path, 921_600).close()
    assert caplog.text == ""


class _Ioctl:
    """Stands in for a kernel driver with serial settings."""

    def __init__(self, flags: int, refuse: OSError | None = None) -> None:
        self.flags, self.refuse, self.sets = flags, refuse, 0

    def __call__(self, _descriptor: int, request: int, settings: Any) -> int:
        if request == 0x541E:
            struct.pack_into("=i", settings, 16, self.flags)
        else:
            if self.refuse:
                raise self.refuse
            (self.flags,) = struct.unpack_from("=i", settings, 16)
            self.sets += 1
        return 0


@pytest.mark.parametrize(("before", "sets"), [(0x10000040, 1), (0x10002040, 0)])
def test_the_low_latency_flag_is_set_and_no_other_touched(
    monkeypatch: pytest.MonkeyPatch, before: int, sets: int
) -> None:
    kernel = _Ioctl(before)
    monkeypatch.setattr(fcntl, "ioctl", kernel)
    port.set_low_latency(3, "/dev/ttyS0")
    assert (kernel.flags, kernel.sets) == (0x10002040, sets)


def test_a_refused_low_latency_flag_is_told(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr(fcntl, "ioctl", _Ioctl(0, PermissionError(1, "Operation not permitted")))
    port.set_low_latency(3, "/dev/ttyS0")
    assert "/dev/ttyS0: the low-latency flag cannot be set (Operation not permitted)" in caplog.text


def test_the_ftdi_timer_is_lowered(tmp_path: Path) -> None:
    timer = tmp_path / "latency_timer"
    timer.write_text("16\n")
    port.set_ftdi_timer(timer, "/dev/ttyUSB0")
    assert timer.read_text() == "1\n"


def test_a_refused_ftdi_timer_is_told_with_the_repair(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    timer = tmp_path / "latency_timer"
    timer.write_text("16\n")

    def refuse(*_: object, **__: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "write_text", refuse)
    port.set_ftdi_timer(timer, "/dev/ttyUSB0")
    assert "/dev/ttyUSB0: the FTDI latency timer is 16 ms and cannot be set to 1 ms (Permission denied)" in caplog.text
    assert f"As root: echo 1 > {timer}" in caplog.text


def test_a_port_without_an_ftdi_chip_is_left_alone(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    port.set_ftdi_timer(tmp_path / "latency_timer", "/dev/ttyS0")
    assert caplog.text == ""
    assert list(tmp_path.iterdir()) == []


def test_a_break_is_a_byte_and_no_signal() -> None:
    with line() as (_, path):
        opened = port.open_port(path, 921_600)
        attributes = termios.tcgetattr(opened.fileno())
        assert not attributes[0] & (termios.BRKINT | termios.IGNBRK | termios.PARMRK | termios.IXON | termios.ICRNL)
        assert not attributes[3] & (termios.ICANON | termios.ECHO | termios.ISIG)
        opened.close()


def test_a_plain_file_is_no_port(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no port")
    for path in (tmp_path / "notes.txt", tmp_path):
        with pytest.raises(DriverError, match="not a serial port, but a file or folder"):
            port.open_port(str(path), 115200)
    assert (tmp_path / "notes.txt").read_text() == "no port"
