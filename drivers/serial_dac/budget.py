"""Transmission times on the line: bytes of one exchange at a baud rate, and the resulting servo rates and time-outs.

One byte is ten bits on the line (start, eight, stop). An exchange is SAMPLE, its reply and COMMAND.
"""

from __future__ import annotations

from typing import Final

from drivers.interface import PROCESSING_S
from drivers.serial_dac.framing import OVERHEAD
from drivers.serial_dac.messages import COMMAND_LENGTH, INPUTS_REPLY_LENGTH, SAMPLE_LENGTH, SAMPLE_REPLY_LENGTH

_BITS_PER_BYTE = 10
SAMPLE_BYTES: Final = SAMPLE_LENGTH + OVERHEAD
REPLY_BYTES: Final = SAMPLE_REPLY_LENGTH + OVERHEAD
COMMAND_BYTES: Final = COMMAND_LENGTH + OVERHEAD
EXCHANGE_BYTES: Final = SAMPLE_BYTES + REPLY_BYTES + COMMAND_BYTES
INPUTS_BYTES: Final = INPUTS_REPLY_LENGTH - SAMPLE_REPLY_LENGTH
"""Additional bytes of a reply with the inputs."""

LINE_FRACTION: Final = 0.8
"""Largest share of a servo period for transmission; the rest is for the operating system."""
REPLY_MARGIN: Final = 1.25
"""The shortest default reply time-out, in transmission times of SAMPLE and reply."""
WATCHDOG_PERIODS: Final = 2
"""The board's watchdog must be longer than this, to tolerate one lost COMMAND."""


def wire_s(count: int, baud: int) -> float:
    """Time in s of ``count`` bytes on the line."""
    return count * _BITS_PER_BYTE / baud


def fastest_rate_hz(baud: int, size: int = EXCHANGE_BYTES) -> float:
    """The highest servo rate in Hz at a baud rate, with exchanges of ``size`` bytes."""
    return LINE_FRACTION / wire_s(size, baud)


def slowest_baud(rate_hz: float, size: int = EXCHANGE_BYTES) -> int:
    """The lowest baud rate for a servo rate, with exchanges of ``size`` bytes."""
    return -int(-size * _BITS_PER_BYTE * rate_hz // LINE_FRACTION)


def default_latency_s(baud: int, more: int = 0) -> float:
    """Sample-to-current latency in s: transmission of reply (plus ``more`` bytes) and COMMAND, and processing."""
    return wire_s(REPLY_BYTES + more + COMMAND_BYTES, baud) + PROCESSING_S


def rate_refusal(
    rate_hz: float, baud: int, watchdog_ms: int, reply_timeout_s: float | None, more: int = 0
) -> str | None:
    """Why a servo rate is not possible with these options, and ``more`` bytes per reply, in words; None if it is."""
    period = 1.0 / rate_hz
    size = EXCHANGE_BYTES + more
    if rate_hz > fastest_rate_hz(baud, size):
        return (
            f"an exchange of {size} bytes takes {wire_s(size, baud) * 1e6:.0f} µs at driver.baud = "
            f"{baud}, and may take {LINE_FRACTION:.0%} of the period of {period * 1e6:.0f} µs: "
            f"at most {int(fastest_rate_hz(baud, size))} Hz, or at least {slowest_baud(rate_hz, size)} baud for "
            f"{rate_hz:g} Hz"
        )
    if watchdog_ms < WATCHDOG_PERIODS * period * 1e3:
        return (
            f"driver.watchdog_ms = {watchdog_ms} ms must be at least {WATCHDOG_PERIODS} servo periods, "
            f"{WATCHDOG_PERIODS * period * 1e3:.4g} ms at {rate_hz:g} Hz"
        )
    longest = period - wire_s(COMMAND_BYTES, baud)
    if reply_timeout_s is not None and reply_timeout_s > longest:
        return (
            f"driver.reply_timeout_s = {reply_timeout_s:g} s leaves no time for the command: at most {longest:.3g} s "
            f"at {rate_hz:g} Hz and {baud} baud"
        )
    return None
