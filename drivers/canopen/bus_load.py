"""Bits on a classic CAN bus: load by the servo loop, and the highest rate.

Worst-case length of a frame with an 11-bit identifier and n bytes of data, with bit stuffing and interframe space
(R. Davis, A. Burns, R. Bril, J. Lukkien, "Controller Area Network (CAN) schedulability analysis: Refuted, revisited and
revised", Real-Time Systems 35, 2007, eq. 1 with g = 34)::

    C = 34 + 8 n + 13 + floor((34 + 8 n - 1) / 4)   bits
"""

from __future__ import annotations

from typing import Final

DEFAULT_BITRATE: Final = 1_000_000
DEFAULT_WATCHDOG_MS: Final = 100
BITRATES: Final = (10_000, 20_000, 50_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)
"""Bit rates of CiA 301, bit/s."""
USABLE: Final = 0.85
"""Largest bus load by the loop: the rest is for EMCY, and for the response times of drive and host."""
GUARDS_PER_WATCHDOG: Final = 4
"""Guarding messages within the watchdog's time (life time factor, 0x100D)."""


def frame_bits(data_bytes: int) -> int:
    """Worst-case bits of a frame with ``data_bytes`` (0…8) bytes of data; a remote frame has none."""
    return 34 + 8 * data_bytes + 13 + (34 + 8 * data_bytes - 1) // 4


TICK_BITS: Final = frame_bits(0) + frame_bits(8) + frame_bits(4)
"""SYNC, TPDO 1 and RPDO 1: 285 bits."""
READ_BACK_BYTES: Final = 3
"""Of TPDO 2: demand and mode of operation, 85 bits."""
INPUTS_BYTES: Final = 4
"""Of TPDO 2: the digital inputs."""
GUARD_BITS: Final = frame_bits(0) + frame_bits(1)
"""A node guarding request and its reply: 120 bits."""


def _guard_bits_per_s(watchdog_ms: float) -> float:
    return GUARD_BITS * GUARDS_PER_WATCHDOG * 1e3 / watchdog_ms


def tick_bits(back_bytes: int) -> int:
    """Worst-case bits of one tick, with a TPDO 2 of ``back_bytes`` bytes; 0: without one."""
    return TICK_BITS + (frame_bits(back_bytes) if back_bytes else 0)


def bus_load(
    rate_hz: float,
    bitrate: float = DEFAULT_BITRATE,
    watchdog_ms: float = DEFAULT_WATCHDOG_MS,
    back_bytes: int = READ_BACK_BYTES,
) -> float:
    """Worst-case bus load by the loop, 1 for a full bus.

    Args:
        rate_hz: servo rate, Hz. bitrate: bit/s. watchdog_ms: the drive's watchdog, ms. back_bytes: of TPDO 2.
    """
    return (tick_bits(back_bytes) * rate_hz + _guard_bits_per_s(watchdog_ms)) / bitrate


def fastest_rate_hz(
    bitrate: float = DEFAULT_BITRATE, watchdog_ms: float = DEFAULT_WATCHDOG_MS, back_bytes: int = READ_BACK_BYTES
) -> float:
    """Highest servo rate in Hz with a bus load of at most USABLE."""
    return max(0.0, (USABLE * bitrate - _guard_bits_per_s(watchdog_ms)) / tick_bits(back_bytes))


def wire_time_s(bitrate: float = DEFAULT_BITRATE) -> float:
    """Transmission time in s from the sample (at the end of SYNC) to the command's arrival: TPDO 1 and RPDO 1."""
    return (frame_bits(8) + frame_bits(4)) / bitrate
