"""The compiled exchange on the port's descriptor: SAMPLE and its reply in ``read``, COMMAND in ``write``.

Every wait is bounded: the descriptor does not block, and the reply has a deadline, also under other traffic. Late
replies, duplicates and invalid bytes before the reply are read and dropped.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from drivers import libc
from drivers.interface import (
    DEVICE_FAULT,
    EXCHANGE_WORDS,
    LOST,
    MISSED,
    OK,
    STATUS_ENABLED,
    STATUS_HELD,
    X_CODE,
    X_COUNTS,
    X_CURRENT_MEASURED,
    X_DEVICE_CODE,
    X_ENABLE,
    X_PERIOD_NS,
    X_STATUS,
)
from drivers.serial_dac import messages as m
from drivers.serial_dac import state as s
from drivers.serial_dac.framing import (
    DECODER_SIZE,
    PAYLOAD_SIZE,
    encode,
    push_until_frame,
)
from hapticd.jit import carray, cfunc, njit

SIGNATURE = types.int32(types.CPointer(types.int64), types.CPointer(types.int64))
_EAGAIN = 11
_EINTR = 4


@njit("int64(int64[::1], uint8[::1], int64)", counted=False)
def _send(words: NDArray[Any], memory: NDArray[Any], size: int) -> int:
    """Encode the request of ``size`` bytes and write it: OK, MISSED (incomplete) or LOST."""
    request = memory[s.REQUEST_AT : s.REQUEST_AT + PAYLOAD_SIZE]
    length = encode(request, size, memory[s.TX_AT + 2 : s.TX_AT + s.TX_SIZE])
    start = s.TX_AT + 2
    if words[s.S_TORN] != 0:
        # A delimiter alone could complete an old command; a wrong byte before it makes that invalid.
        memory[s.TX_AT] = words[s.S_TORN]
        memory[s.TX_AT + 1] = 0
        start -= 2
        length += 2
    put = libc.write(words[s.S_DESCRIPTOR], memory.ctypes.data + start, length)
    if put == length:
        words[s.S_TORN] = 0
        return OK
    if put > 0:
        words[s.S_TORN] = 1 if memory[start + put] != 1 else 2
        return MISSED
    if put in (0, -_EAGAIN, -_EINTR):
        return MISSED
    words[s.S_LOST] = s.GONE
    return LOST


@njit("int64(int64[::1], uint8[::1])", counted=False)
def _fetch(words: NDArray[Any], memory: NDArray[Any]) -> int:
    """Read received bytes into the chunk: their number, 0 for none, or LOST."""
    got = libc.read(words[s.S_DESCRIPTOR], memory.ctypes.data + s.CHUNK_AT, s.CHUNK_SIZE)
    words[s.S_POSITION] = 0
    if got > 0:
        return got
    if got in (-_EAGAIN, -_EINTR):
        return 0
    words[s.S_LOST] = s.GONE
    return LOST


@njit("boolean(int64[::1], uint8[::1], int64, int64)", counted=False)
def _find_reply(words: NDArray[Any], memory: NDArray[Any], size: int, seq: int) -> bool:
    """Whether the chunk's next bytes complete a reply with that seq (-1: none); other frames are counted and dropped."""
    decoder = memory[s.DECODER_AT : s.DECODER_AT + DECODER_SIZE]
    payload = memory[s.PAYLOAD_AT : s.PAYLOAD_AT + PAYLOAD_SIZE]
    chunk = memory[s.CHUNK_AT : s.CHUNK_AT + s.CHUNK_SIZE]
    position = words[s.S_POSITION : s.S_POSITION + 1]
    while position[0] < size:
        length = push_until_frame(decoder, payload, chunk, size, position)
        plain = length == m.SAMPLE_REPLY_LENGTH and payload[0] == m.SAMPLE_REPLY
        if plain or (length == m.INPUTS_REPLY_LENGTH and payload[0] == m.INPUTS_REPLY):
            if payload[1] == seq:
                return True
            words[s.S_STALE] += 1
        elif length < 0:
            words[s.S_BAD_FRAMES] += 1
    return False


@njit("int64(uint8[::1], int64)", counted=False)
def _u32(payload: NDArray[Any], at: int) -> int:
    return int(payload[at]) | (int(payload[at + 1]) << 8) | (int(payload[at + 2]) << 16) | (int(payload[at + 3]) << 24)


@njit("int64(int64, int64, int64)", counted=False)
def unwrapped(position: int, count: int, bits: int) -> int:
    """The 64-bit position nearest to ``position`` whose low ``bits`` bits are those of ``count``."""
    half = 1 << (bits - 1)
    mask = (1 << bits) - 1
    return position + ((count - position + half) & mask) - half


@cfunc(SIGNATURE)
def read(state: int, exchange: int) -> int:
    """Send SAMPLE, receive its reply within the time-out."""
    words = carray(state, (s.STATE_WORDS,))
    memory = words.view(np.uint8)
    x = carray(exchange, (EXCHANGE_WORDS,))
    x_float = x.view(np.float64)
    x_float[X_CURRENT_MEASURED] = np.nan
    if words[s.S_LOST] != 0:
        return LOST
    clock = words[s.S_CLOCK : s.S_CLOCK + libc.SCRATCH]
    words[s.S_SEQ] = (words[s.S_SEQ] + 1) & 0xFF
    memory[s.REQUEST_AT] = m.SAMPLE_INPUTS if words[s.S_INPUTS] == 1 else m.SAMPLE
    memory[s.REQUEST_AT + 1] = words[s.S_SEQ]
    sent = _send(words, memory, m.SAMPLE_LENGTH)
    if sent != OK:
        return sent
    period = int(x_float[X_PERIOD_NS])
    timeout = words[s.S_TIMEOUT_NS]
    if timeout == 0:
        timeout = max(4 * period // 5, words[s.S_REPLY_NS])
    deadline = libc.now_ns(clock) + min(timeout, period - words[s.S_COMMAND_NS])
    found = False
    while not found:
        events = libc.wait_until(clock, words[s.S_DESCRIPTOR], libc.POLLIN, deadline)
        if events == 0:
            return MISSED
        got = _fetch(words, memory)
        if got < 0:
            return LOST
        found = _find_reply(words, memory, got, words[s.S_SEQ])
        # With continuous input the wait would never reach its deadline.
        if not found and libc.now_ns(clock) >= deadline:
            return MISSED
    payload = memory[s.PAYLOAD_AT : s.PAYLOAD_AT + PAYLOAD_SIZE]
    status = int(payload[10])
    if status & m.STATUS_UNCONFIGURED:
        words[s.S_LOST] = s.RESTARTED
        return LOST
    words[s.S_COUNTS] = unwrapped(words[s.S_COUNTS], _u32(payload, 2), words[s.S_COUNTER_BITS])
    words[s.S_UNPROVEN] = 0 if payload[11] == words[s.S_COMMAND_SEQ] else 1
    x[X_COUNTS] = words[s.S_COUNTS]
    held = payload[0] == m.INPUTS_REPLY and payload[12] & m.INPUT_HELD  # only a reply of this kind has inputs
    x[X_STATUS] = (STATUS_ENABLED if status & m.STATUS_ENABLED else 0) | (STATUS_HELD if held else 0)
    x[X_DEVICE_CODE] = status
    # Bytes after the reply belong to no exchange, but may be the beginning of a frame.
    _find_reply(words, memory, got, -1)
    return DEVICE_FAULT if status & m.STATUS_FAULTS else OK


@cfunc(SIGNATURE)
def write(state: int, exchange: int) -> int:
    """Send COMMAND; MISSED also if the last reply did not prove the previous COMMAND."""
    words = carray(state, (s.STATE_WORDS,))
    memory = words.view(np.uint8)
    x = carray(exchange, (EXCHANGE_WORDS,))
    if words[s.S_LOST] != 0:
        return LOST
    middle = 1 << (words[s.S_DAC_BITS] - 1)
    enable = 1 if x[X_ENABLE] == 1 else 0
    code = min(max(middle + x[X_CODE], 0), 2 * middle - 1) if enable == 1 else middle
    memory[s.REQUEST_AT] = m.COMMAND
    memory[s.REQUEST_AT + 1] = words[s.S_SEQ]
    memory[s.REQUEST_AT + 2] = code & 0xFF
    memory[s.REQUEST_AT + 3] = code >> 8
    memory[s.REQUEST_AT + 4] = enable | m.FLAG_WHILE_HELD if enable and words[s.S_INPUTS] == 1 else enable
    sent = _send(words, memory, m.COMMAND_LENGTH)
    if sent != OK:
        return sent
    words[s.S_COMMAND_SEQ] = words[s.S_SEQ]
    unproven = words[s.S_UNPROVEN]
    words[s.S_UNPROVEN] = 0
    return MISSED if unproven == 1 else OK
