"""Frames of the serial DAC protocol: COBS over payload and CRC-16/CCITT-FALSE, ended by a zero byte.

Specification: ``docs/protocols/serial-dac.md``. COBS: Cheshire and Baker, IEEE/ACM Trans. Networking 7(2), 1999. CRC:
CRC-16/IBM-3740 of the CRC catalogue. Everything here is compiled and allocates nothing; :class:`Decoder` and
:func:`frame` are the same code for Python.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.jit import njit

MAX_PAYLOAD: Final = 32
"""Longest payload, bytes."""
MAX_CODED: Final = MAX_PAYLOAD + 3
"""Longest coded frame before its delimiter: payload, two bytes of CRC, one of COBS."""
OVERHEAD: Final = 4
"""Bytes on the line in addition to the payload: CRC, COBS and delimiter."""
DECODER_SIZE: Final = 1 + MAX_CODED
"""Bytes of a decoder's memory: the number of bytes collected, then the bytes."""
PAYLOAD_SIZE: Final = MAX_PAYLOAD + 2
"""Bytes of a buffer for a payload and its CRC."""

NOTHING: Final = 0
BAD_CODING: Final = -1
"""A frame that is too long, or whose COBS points beyond its end."""
BAD_CRC: Final = -2

_POLYNOMIAL = 0x1021
_CRC_START = 0xFFFF


def _crc_table() -> NDArray[np.int64]:
    table = np.arange(256, dtype=np.int64) << 8
    for _ in range(8):
        table = np.where(table & 0x8000, (table << 1) ^ _POLYNOMIAL, table << 1) & 0xFFFF
    return table


_CRC_TABLE = _crc_table()


@njit("int64(uint8[::1], int64)", counted=False)
def crc16(data: NDArray[Any], size: int) -> int:
    """CRC-16/CCITT-FALSE of the first ``size`` bytes; of ``123456789`` it is 0x29B1."""
    crc = _CRC_START
    for index in range(size):
        crc = ((crc << 8) & 0xFFFF) ^ _CRC_TABLE[(crc >> 8) ^ data[index]]
    return crc


@njit("int64(uint8[::1], int64, uint8[::1])", counted=False)
def encode(payload: NDArray[Any], size: int, out: NDArray[Any]) -> int:
    """Frame the first ``size`` bytes of a payload.

    Args:
        payload: uint8[≥ size + 2]; the CRC is written after the payload.
        size: 1 … MAX_PAYLOAD.
        out: uint8[≥ size + OVERHEAD], the frame with its delimiter.

    Returns:
        The frame's length on the line, size + OVERHEAD.
    """
    crc = crc16(payload, size)
    payload[size] = crc & 0xFF
    payload[size + 1] = crc >> 8
    code_at = 0
    put = 1
    for index in range(size + 2):
        if payload[index] == 0:
            out[code_at] = put - code_at
            code_at = put
        else:
            out[put] = payload[index]
        put += 1
    out[code_at] = put - code_at
    out[put] = 0
    return put + 1


@njit("int64(uint8[::1], uint8[::1], uint8)", counted=False)
def push(decoder: NDArray[Any], payload: NDArray[Any], byte: int) -> int:
    """Process one byte of the line.

    Args:
        decoder: uint8[DECODER_SIZE], initially zeros.
        payload: uint8[PAYLOAD_SIZE], filled when a frame is complete.
        byte: from the line.

    Returns:
        The payload's length if this byte completes a valid frame, NOTHING, BAD_CODING or BAD_CRC; after these three the
        payload's content is undefined.
    """
    length = int(decoder[0])
    if byte != 0:
        # One byte more than the longest frame marks a frame that is too long.
        if length < MAX_CODED:
            decoder[1 + length] = byte
        decoder[0] = min(length + 1, MAX_CODED + 1)
        return NOTHING
    decoder[0] = 0
    if length == 0:
        return NOTHING
    if length > MAX_CODED:
        return BAD_CODING
    put = 0
    at = 0
    while at < length:
        end = at + int(decoder[1 + at])
        if end > length:
            return BAD_CODING
        for index in range(at + 1, end):
            payload[put] = decoder[1 + index]
            put += 1
        if end < length:
            payload[put] = 0
            put += 1
        at = end
    size = put - 2
    if size < 1:
        return BAD_CODING
    return size if crc16(payload, size) == int(payload[size]) | int(payload[size + 1]) << 8 else BAD_CRC


@njit("int64(uint8[::1], uint8[::1], uint8[::1], int64, int64[::1])", counted=False)
def push_until_frame(
    decoder: NDArray[Any], payload: NDArray[Any], data: NDArray[Any], size: int, position: NDArray[Any]
) -> int:
    """Push bytes from ``data[position[0]]`` on until a frame ends or ``size`` is reached; ``position[0]`` is updated.

    Returns:
        As :func:`push` for the last byte pushed.
    """
    while position[0] < size:
        result = push(decoder, payload, data[position[0]])
        position[0] += 1
        if result != NOTHING:
            return int(result)
    return NOTHING


def frame(payload: bytes) -> bytes:
    """The bytes on the line of one payload.

    Raises:
        ValueError: the payload is empty or longer than MAX_PAYLOAD.
    """
    if not 1 <= len(payload) <= MAX_PAYLOAD:
        raise ValueError(f"the payload has {len(payload)} bytes; a frame takes 1 … {MAX_PAYLOAD}")
    room = np.zeros(PAYLOAD_SIZE, np.uint8)
    room[: len(payload)] = np.frombuffer(payload, np.uint8)
    out = np.zeros(MAX_PAYLOAD + OVERHEAD, np.uint8)
    return out[: encode(room, len(payload), out)].tobytes()


class Decoder:
    """The compiled decoder for Python: bytes in, payloads of the valid frames out.

    Attributes:
        bad_coding: frames dropped for their length or COBS.
        bad_crc: frames dropped for their CRC.
    """

    def __init__(self) -> None:
        self.bad_coding = 0
        self.bad_crc = 0
        self._decoder = np.zeros(DECODER_SIZE, np.uint8)
        self._payload = np.zeros(PAYLOAD_SIZE, np.uint8)
        self._position = np.zeros(1, np.int64)

    def feed(self, data: bytes) -> list[bytes]:
        """Payloads of the valid frames that end within ``data``, in order."""
        found = []
        raw = np.frombuffer(bytearray(data), np.uint8)
        self._position[0] = 0
        while self._position[0] < raw.size:
            size = push_until_frame(self._decoder, self._payload, raw, raw.size, self._position)
            if size == BAD_CODING:
                self.bad_coding += 1
            elif size == BAD_CRC:
                self.bad_crc += 1
            elif size != NOTHING:
                found.append(self._payload[:size].tobytes())
        return found
