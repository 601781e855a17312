"""Frames of the board's line, compiled: COBS (Cheshire and Baker, 1999) around a payload and its CRC-16/CCITT-FALSE."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from hapticd.jit import njit
from sim_hw.layout import BYTES, I64

LONGEST_PAYLOAD = 32
LONGEST_FRAME = LONGEST_PAYLOAD + 3
"""Bytes before the delimiter: payload, CRC and the one byte that COBS adds."""


@njit(I64(BYTES, I64), counted=False)
def crc16(data: NDArray[Any], length: int) -> int:
    """CRC-16/CCITT-FALSE of the first ``length`` bytes: polynomial 0x1021, from 0xFFFF, highest bit first."""
    crc = 0xFFFF
    for n in range(length):
        crc ^= int(data[n]) << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1
        crc &= 0xFFFF
    return crc


@njit(I64(BYTES, I64, BYTES), counted=False)
def encode(payload: NDArray[Any], length: int, wire: NDArray[Any]) -> int:
    """Write a payload's frame with its delimiter into ``wire``; bytes written, ``length`` + 4.

    Args:
        payload: its first ``length`` bytes are sent; the two after them are overwritten with the CRC.
    """
    crc = crc16(payload, length)
    payload[length] = crc & 0xFF
    payload[length + 1] = crc >> 8
    start = 0  # index of the length byte of the present block
    end = 1
    for n in range(length + 2):
        if payload[n] == 0:
            wire[start] = end - start
            start = end
        else:
            wire[end] = payload[n]
        end += 1
    wire[start] = end - start
    wire[end] = 0
    return end + 1


@njit(I64(BYTES, I64, BYTES), counted=False)
def decode(raw: NDArray[Any], length: int, payload: NDArray[Any]) -> int:
    """Decode the bytes before a delimiter; returns the payload's length, or −1 for a bad frame.

    Args:
        raw: its first ``length`` bytes, at most LONGEST_FRAME. payload: buffer of LONGEST_PAYLOAD + 2 bytes.
    """
    if length < 4 or length > LONGEST_FRAME:
        return -1
    size = 0
    start = 0
    while start < length:
        step = int(raw[start])
        if step == 0 or start + step > length:
            return -1
        for n in range(start + 1, start + step):
            if raw[n] == 0:
                return -1
            payload[size] = raw[n]
            size += 1
        start += step
        if start < length:
            payload[size] = 0
            size += 1
    size -= 2
    if size < 1 or crc16(payload, size) != int(payload[size]) | (int(payload[size + 1]) << 8):
        return -1
    return size
