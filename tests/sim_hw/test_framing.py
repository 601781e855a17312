"""The board's framing against the test host's, which was written apart from it: they agree on every string of bytes."""

import random

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sim_hw.serial_board.framing import LONGEST_FRAME, LONGEST_PAYLOAD, crc16, decode, encode
from tests.sim_hw.host import stuffed, unstuffed

_ROOM = 64


def _array(data: bytes) -> np.ndarray[tuple[int], np.dtype[np.uint8]]:
    array = np.zeros(_ROOM, np.uint8)
    array[: len(data)] = np.frombuffer(data, np.uint8)
    return array


def board_decodes(raw: bytes) -> bytes | None:
    payload = np.zeros(_ROOM, np.uint8)
    length = decode(_array(raw), len(raw), payload)
    return None if length < 0 else payload[:length].tobytes()


def test_check_value_of_the_crc() -> None:
    assert crc16(_array(b"123456789"), 9) == 0x29B1


@given(st.binary(min_size=1, max_size=LONGEST_PAYLOAD))
@example(bytes(LONGEST_PAYLOAD))
def test_encodes_as_the_host_does_and_decodes_it_again(payload: bytes) -> None:
    wire = np.zeros(_ROOM, np.uint8)
    length = encode(_array(payload), len(payload), wire)
    assert wire[:length].tobytes() == stuffed(payload)
    assert board_decodes(stuffed(payload)[:-1]) == payload


@settings(max_examples=300)
@given(st.binary(max_size=LONGEST_FRAME))
@example(b"")
@example(b"\x01\x01\x01\x01")
def test_any_bytes(raw: bytes) -> None:
    assert board_decodes(raw) == unstuffed(raw)


@pytest.mark.parametrize("seed", range(4))
def test_mutated_frames(seed: int) -> None:
    """Bits flipped, bytes lost and added: both ends drop the same, and no frame gets through changed."""
    generator = random.Random(seed)
    accepted = 0
    for _ in range(2000):
        payload = generator.randbytes(generator.randint(1, LONGEST_PAYLOAD))
        raw = bytearray(stuffed(payload)[:-1])
        for _ in range(generator.randint(1, 3)):
            place = generator.randrange(len(raw))
            match generator.randrange(3):
                case 0:
                    raw[place] ^= 1 << generator.randrange(8)
                case 1 if len(raw) > 1:
                    del raw[place]
                case _:
                    raw.insert(place, generator.randrange(256))
        frame = bytes(raw[:LONGEST_FRAME])
        decoded = board_decodes(frame)
        assert decoded == unstuffed(frame)
        accepted += decoded is not None and decoded != payload
    assert accepted <= 2  # one in 65536 is what a CRC of 16 bits lets through


def test_longer_than_any_frame() -> None:
    assert board_decodes(stuffed(bytes(LONGEST_PAYLOAD + 1))[:-1]) is None
