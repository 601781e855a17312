"""The serial port: opened by pyserial, exclusive, raw, not blocking, and without the delays of Linux and FTDI.

``ASYNC_LOW_LATENCY`` (``TIOCSSERIAL``) forwards received bytes at once; an FTDI chip delays a short packet by its latency
timer, 16 ms by default (FTDI application note AN232B-04). Pseudo-terminals have neither.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import stat
import struct
import termios
import time
from pathlib import Path

import serial

from drivers.interface import DriverError

log = logging.getLogger(__name__)

SYS_CLASS_TTY = Path("/sys/class/tty")
_TIOCGSERIAL = 0x541E
_TIOCSSERIAL = 0x541F
_SERIAL_STRUCT = 72
_FLAGS_AT = 16
_ASYNC_LOW_LATENCY = 1 << 13
_FTDI_TIMER_MS = 1
_POLL_S = 0.001
_HINTS = {
    errno.ENOENT: "no such device; is it plugged in? 'ls /dev/serial/by-id' lists the ports",
    errno.EACCES: "permission denied; on most systems the user must be in the group dialout",
    errno.EAGAIN: "in use by another process ('fuser -v' on it shows which)",
    errno.EBUSY: "in use by another process ('fuser -v' on it shows which)",
    errno.ENOTTY: "not a serial port, but a file or folder; 'ls /dev/serial/by-id' lists the ports",
    errno.ENODEV: "the device is gone",
    errno.ENXIO: "the device is gone",
}


def open_port(path: str, baud: int) -> serial.Serial:
    """Open a serial port for the compiled exchange; old input is discarded.

    Raises:
        DriverError: with the path and the problem.
    """
    port = None
    try:
        if not stat.S_ISCHR(os.stat(path).st_mode):  # noqa: PTH116 - a path as it is written
            raise OSError(errno.ENOTTY, "no character device")
        port = serial.Serial(path, baud, timeout=0, write_timeout=0, exclusive=True)
        _make_raw(port.fileno())
    except (OSError, ValueError, termios.error) as error:
        if port is not None:
            port.close()
        number = error.errno if isinstance(error, OSError) else None
        text = _HINTS.get(number, "") if number is not None else ""
        text = text or " ".join(str(error).split())
        raise DriverError(f"driver.port = {path!r}, driver.baud = {baud}: {text}") from error
    name = os.path.realpath(path)
    if not name.startswith("/dev/pts/"):
        set_low_latency(port.fileno(), path)
        set_ftdi_timer(SYS_CLASS_TTY / Path(name).name / "device" / "latency_timer", path)
    return port


def _make_raw(descriptor: int) -> None:
    """Settings that pyserial does not make: a break is a zero byte, and a read of 0 bytes means that the line is lost."""
    attributes = termios.tcgetattr(descriptor)
    attributes[0] &= ~(termios.BRKINT | termios.IGNBRK | termios.PARMRK | termios.INPCK | termios.ISTRIP)
    attributes[6][termios.VMIN] = 1
    attributes[6][termios.VTIME] = 0
    termios.tcsetattr(descriptor, termios.TCSANOW, attributes)


def set_low_latency(descriptor: int, path: str) -> None:
    """Set ASYNC_LOW_LATENCY if the port's kernel driver has it; a refusal is logged."""
    settings = bytearray(_SERIAL_STRUCT)
    try:
        fcntl.ioctl(descriptor, _TIOCGSERIAL, settings)
    except OSError:
        return  # the port does not have it
    (flags,) = struct.unpack_from("=i", settings, _FLAGS_AT)
    if flags & _ASYNC_LOW_LATENCY:
        return
    struct.pack_into("=i", settings, _FLAGS_AT, flags | _ASYNC_LOW_LATENCY)
    try:
        fcntl.ioctl(descriptor, _TIOCSSERIAL, settings)
    except OSError as error:
        log.warning("%s: the low-latency flag cannot be set (%s); replies may be late", path, error.strerror)


def set_ftdi_timer(timer: Path, path: str) -> None:
    """Set an FTDI adapter's latency timer to 1 ms if there is one; a refusal is logged with the remedy."""
    try:
        found = int(timer.read_text())
    except (OSError, ValueError):
        return  # not an FTDI adapter
    if found <= _FTDI_TIMER_MS:
        return
    try:
        timer.write_text(f"{_FTDI_TIMER_MS}\n")
    except OSError as error:
        log.warning(
            "%s: the FTDI latency timer is %d ms and cannot be set to %d ms (%s); every reply may be that late. As root: "
            "echo %d > %s",
            *(path, found, _FTDI_TIMER_MS, error.strerror, _FTDI_TIMER_MS, timer),
        )


def wait_sent(descriptor: int, longest_s: float) -> None:
    """Wait until the output buffer is empty, at most ``longest_s`` (``tcdrain`` has no time-out)."""
    deadline = time.monotonic() + longest_s
    waiting = bytearray(4)
    while time.monotonic() < deadline:
        fcntl.ioctl(descriptor, termios.TIOCOUTQ, waiting)
        if not any(waiting):
            return
        time.sleep(_POLL_S)
