"""Attacks on the serial decoder: noise, well-coded frames with a wrong CRC, and damaged streams of good frames."""

from __future__ import annotations

import random
from collections.abc import Callable

from drivers.serial_dac import messages
from drivers.serial_dac.framing import MAX_PAYLOAD, Decoder, frame
from tests.drivers.fuzz import Advance, FuzzReport

_ADVANCE_EVERY = 4096
_LONGEST_NOISE = 96
_SENTINEL = messages.sample(0xA5)
_SENTINEL_FRAME = b"\0" + frame(_SENTINEL)
_PARSERS: tuple[Callable[[bytes], object], ...] = (
    messages.hello_reply_head,
    messages.capabilities,
    messages.configure_reply,
    messages.sample_reply,
)

_Input = tuple[bytes, set[bytes]]
"""Bytes of the line, and the payloads that were sent in them."""


def _noise(rng: random.Random) -> _Input:
    length = rng.randrange(_LONGEST_NOISE)
    if rng.random() < 0.5:
        return rng.randbytes(length), set()
    return bytes(rng.choices(range(8), k=length)), set()


def _wrong_crc(rng: random.Random) -> _Input:
    coded = bytearray()
    for piece in rng.randbytes(rng.randint(3, MAX_PAYLOAD + 2)).split(b"\0"):
        coded += bytes([len(piece) + 1]) + piece
    return bytes(coded) + b"\0", set()


def _payload(rng: random.Random) -> bytes:
    kind = rng.randrange(4)
    if kind == 0:
        return messages.sample(rng.randrange(256))
    if kind == 1:
        return messages.command(rng.randrange(256), rng.randrange(0x10000), enable=bool(rng.randrange(2)))
    if kind == 2:
        return bytes([messages.SAMPLE_REPLY]) + rng.randbytes(messages.SAMPLE_REPLY_LENGTH - 1)
    return rng.randbytes(rng.randint(1, MAX_PAYLOAD))


def _damaged(rng: random.Random) -> _Input:
    sent = [_payload(rng) for _ in range(rng.randint(1, 4))]
    line = bytearray(b"".join(map(frame, sent)))
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(line))
        kind = rng.randrange(6)
        if kind == 0:
            line[at] ^= 1 << rng.randrange(8)
        elif kind == 1:
            line[at] = rng.randrange(256)
        elif kind == 2:
            line.insert(at, rng.randrange(256))
        elif kind == 3 and len(line) > 1:
            del line[at]
        elif kind == 4:
            line[at:at] = line[at : at + rng.randint(1, 16)]
        elif len(line) > 1:
            del line[rng.randrange(1, len(line)) :]
    return bytes(line), set(sent)


_ATTACKS = (_noise, _wrong_crc, _damaged)


def fuzz(count: int, seed: int, advance: Advance) -> FuzzReport:
    """Give ``count`` byte strings to one decoder; a good frame after each must come through.

    Args:
        count: byte strings. seed: of the generator; the same seed gives the same strings.
        advance: told the number done so far.
    """
    rng = random.Random(seed)
    decoder = Decoder()
    report = FuzzReport(inputs=count, odds=2.0**-16)
    for number in range(count):
        if number % _ADVANCE_EVERY == 0:
            advance(number)
        line, sent = _ATTACKS[number % len(_ATTACKS)](rng)
        *found, last = [*decoder.feed(line), *decoder.feed(_SENTINEL_FRAME)] or [b""]
        if last != _SENTINEL:
            report.violations.append(f"input {number}: no good frame came through after {line.hex(' ')}")
        for payload in found:
            for parse in _PARSERS:
                parse(payload)
            if payload in sent:
                report.accepted += 1
            else:
                report.wrong += 1
    report.checked = decoder.bad_crc + report.wrong
    report.rejected = {"length or COBS": decoder.bad_coding, "CRC": decoder.bad_crc}
    return report
