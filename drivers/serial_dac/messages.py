"""Messages of the serial DAC protocol, version 1 (``docs/protocols/serial-dac.md``): types, fields, status bits."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

VERSION: Final = 1

HELLO: Final = 0x01
CONFIGURE: Final = 0x02
SAMPLE: Final = 0x03
COMMAND: Final = 0x04
SAMPLE_INPUTS: Final = 0x05
HELLO_REPLY: Final = 0x81
CONFIGURE_REPLY: Final = 0x82
SAMPLE_REPLY: Final = 0x83
INPUTS_REPLY: Final = 0x84

SAMPLE_LENGTH: Final = 2
COMMAND_LENGTH: Final = 5
SAMPLE_REPLY_LENGTH: Final = 12
INPUTS_REPLY_LENGTH: Final = SAMPLE_REPLY_LENGTH + 1
"""A SAMPLE reply, followed by the inputs."""

INPUT_HELD: Final = 1
FLAG_WHILE_HELD: Final = 2

STATUS_ENABLED: Final = 1
STATUS_WATCHDOG: Final = 2
STATUS_ENCODER_FAULT: Final = 4
STATUS_AMPLIFIER_FAULT: Final = 8
STATUS_EXTERNAL_STOP: Final = 64
STATUS_UNCONFIGURED: Final = 128
STATUS_FAULTS: Final = STATUS_WATCHDOG | STATUS_ENCODER_FAULT | STATUS_AMPLIFIER_FAULT | STATUS_EXTERNAL_STOP
"""Bits that keep the output off in a continuing session; UNCONFIGURED ends it."""

_HELLO_HEAD = struct.Struct("<BBH")
_CAPABILITIES = struct.Struct("<BIBHHIH")
_CONFIGURE = struct.Struct("<BH")
_SAMPLE = struct.Struct("<BB")
_COMMAND = struct.Struct("<BBHB")
_SAMPLE_REPLY = struct.Struct("<BBIIBB")


@dataclass(frozen=True)
class Capabilities:
    """The capabilities in a board's HELLO reply."""

    dac_bits: int
    full_scale_ua: int
    """Full scale in µA."""
    counter_bits: int
    watchdog_min_ms: int
    watchdog_max_ms: int
    serial_number: int
    firmware: int
    """Major version in the high byte, minor in the low one."""

    @property
    def firmware_text(self) -> str:
        """The firmware's version, as ``1.2``."""
        return f"{self.firmware >> 8}.{self.firmware & 0xFF}"


@dataclass(frozen=True)
class SampleReply:
    """A SAMPLE reply; ``count`` as received, not unwrapped."""

    seq: int
    count: int
    board_time_us: int
    status: int
    command_seq: int


def hello(nonce: int) -> bytes:
    """Payload of HELLO."""
    return _HELLO_HEAD.pack(HELLO, VERSION, nonce)


def configure(watchdog_ms: int) -> bytes:
    """Payload of CONFIGURE."""
    return _CONFIGURE.pack(CONFIGURE, watchdog_ms)


def sample(seq: int, *, inputs: bool = False) -> bytes:
    """Payload of SAMPLE, or of SAMPLE_INPUTS."""
    return _SAMPLE.pack(SAMPLE_INPUTS if inputs else SAMPLE, seq)


def command(seq: int, code: int, *, enable: bool) -> bytes:
    """Payload of COMMAND; ``code`` is offset binary."""
    return _COMMAND.pack(COMMAND, seq, code, enable)


def hello_reply_head(payload: bytes) -> tuple[int, int] | None:
    """Version and nonce of a HELLO reply, of any version; None for another message."""
    if len(payload) < _HELLO_HEAD.size or payload[0] != HELLO_REPLY:
        return None
    _, version, nonce = _HELLO_HEAD.unpack_from(payload)
    return version, nonce


def capabilities(payload: bytes) -> Capabilities | None:
    """Capabilities in a HELLO reply of this version; None if its length is wrong."""
    if len(payload) != _HELLO_HEAD.size + _CAPABILITIES.size:
        return None
    return Capabilities(*_CAPABILITIES.unpack_from(payload, _HELLO_HEAD.size))


def configure_reply(payload: bytes) -> int | None:
    """Watchdog time in ms of a CONFIGURE reply, 0 for refused; None for another message."""
    if len(payload) != _CONFIGURE.size or payload[0] != CONFIGURE_REPLY:
        return None
    return int(_CONFIGURE.unpack(payload)[1])


def sample_reply(payload: bytes, *, inputs: bool = False) -> SampleReply | None:
    """A SAMPLE reply, or with ``inputs`` one to SAMPLE_INPUTS; None for another message."""
    kind, length = (INPUTS_REPLY, INPUTS_REPLY_LENGTH) if inputs else (SAMPLE_REPLY, SAMPLE_REPLY_LENGTH)
    if len(payload) != length or payload[0] != kind:
        return None
    return SampleReply(*_SAMPLE_REPLY.unpack_from(payload)[1:])
