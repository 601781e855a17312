"""Worst-case frame lengths against a bit-by-bit count, and what follows for the servo rate."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import drivers
from drivers.canopen import bus_load
from drivers.interface import PROCESSING_S
from hapticd.config import parse_config


def stuffed_bits(bits: list[int]) -> int:
    """Length after CAN's bit stuffing: a bit of the other kind after five equal ones, itself counted."""
    length, run, last = 0, 0, -1
    for bit in bits:
        run = run + 1 if bit == last else 1
        last = bit
        length += 1
        if run == 5:
            length += 1
            run, last = 1, 1 - bit
    return length


@pytest.mark.parametrize("data_bytes", range(9))
def test_no_pattern_is_longer_and_the_worst_one_is_met(data_bytes: int) -> None:
    """34 + 8 n bits are stuffed (identifier … CRC); 13 more are not: delimiters, acknowledge, end and interframe space."""
    stuffable = 34 + 8 * data_bytes
    worst = [0] * 5 + [bit for k in range(stuffable) for bit in ([1] * 4 if k % 2 == 0 else [0] * 4)]
    assert stuffed_bits(worst[:stuffable]) + 13 == bus_load.frame_bits(data_bytes)
    random = np.random.default_rng(data_bytes)
    for _ in range(200):
        bits = [int(bit) for bit in random.integers(2, size=stuffable)]
        assert stuffed_bits(bits) + 13 <= bus_load.frame_bits(data_bytes)


def test_known_lengths_and_the_limits_that_follow() -> None:
    assert (bus_load.frame_bits(8), bus_load.TICK_BITS, bus_load.GUARD_BITS) == (135, 285, 120)
    assert bus_load.frame_bits(bus_load.READ_BACK_BYTES) == 85
    assert bus_load.bus_load(1000.0) == pytest.approx((370_000 + 120 * 40) / 1e6)
    assert bus_load.bus_load(1000.0, back_bytes=0) == pytest.approx((285_000 + 120 * 40) / 1e6)
    for bitrate, back_bytes in itertools.product(bus_load.BITRATES, (0, 3, 4, 7)):
        rate = bus_load.fastest_rate_hz(bitrate, back_bytes=back_bytes)
        assert rate == 0.0 or bus_load.bus_load(rate, bitrate, back_bytes=back_bytes) == pytest.approx(bus_load.USABLE)
    assert bus_load.wire_time_s(1e6) == pytest.approx(230e-6)


@pytest.mark.parametrize(
    ("interface", "channel", "wire_s"),
    [
        ("socketcan", "can0", 230e-6),
        ("slcan", "/dev/ttyACM0", 230e-6),
        ("socketcan", "vcan0", 0.0),
        ("socketcan", "vxcan1", 0.0),
        ("unix_seqpacket", "/tmp/vcan.sock", 0.0),
        ("slcan", "vcan0", 230e-6),
    ],
)
def test_only_what_has_a_wire_declares_its_time(interface: str, channel: str, wire_s: float) -> None:
    config = parse_config({"driver": {"name": "canopen", "interface": interface, "channel": channel}}, "test")
    latency_s, doubt = drivers.declared_latency(config)
    assert latency_s == pytest.approx(wire_s + PROCESSING_S)
    assert doubt is None


def test_check_knows_the_limit_of_the_config() -> None:
    config = parse_config({"driver": {"name": "canopen", "bitrate": 500_000, "watchdog_ms": 40}}, "test")
    assert drivers.max_rate(config)[0] == bus_load.fastest_rate_hz(500_000, 40)
    without = parse_config({"driver": {"name": "canopen", "read_back": False}}, "test")
    assert drivers.max_rate(without)[0] == bus_load.fastest_rate_hz(back_bytes=0)
