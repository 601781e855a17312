"""A second decoder of the serial protocol, written from the document alone and sharing nothing with the driver."""

import binascii


def unstuffed(coded: bytes) -> bytes | None:
    pieces = []
    while coded:
        jump, coded = coded[0], coded[1:]
        if len(coded) < jump - 1:
            return None
        pieces.append(coded[: jump - 1])
        coded = coded[jump - 1 :]
    return b"\0".join(pieces)


def decoded(coded: bytes) -> bytes | None:
    """The payload of what stood between two zeros, or None for a bad frame."""
    plain = unstuffed(coded) if len(coded) <= 35 else None
    if plain is None or len(plain) < 3:
        return None
    payload, check = plain[:-2], int.from_bytes(plain[-2:], "little")
    # CCITT-FALSE is binascii's CCITT polynomial with another initial value.
    return payload if binascii.crc_hqx(payload, 0xFFFF) == check else None


def payloads(line: bytes) -> list[bytes]:
    """Good payloads of a whole line; what follows the last zero is not a frame yet."""
    found = [decoded(coded) for coded in line.split(b"\0")[:-1] if coded]
    return [payload for payload in found if payload is not None]


def framed(payload: bytes) -> bytes:
    plain = payload + binascii.crc_hqx(payload, 0xFFFF).to_bytes(2, "little")
    return b"".join(bytes([len(piece) + 1]) + piece for piece in plain.split(b"\0")) + b"\0"
