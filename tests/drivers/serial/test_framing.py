"""The compiled frames against a decoder written from the document alone, and against the document itself."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.serial_dac.framing import MAX_PAYLOAD, Decoder, crc16, frame
from tests.drivers.serial import reference

DOCUMENT = Path(__file__).parents[3] / "docs" / "protocols" / "serial-dac.md"
_ROW = re.compile(r"\| (.+) \| `([0-9a-f ]+)` \| `([0-9A-F]{4})` \| `([0-9a-f ]+)` \|")
VECTORS = _ROW.findall(DOCUMENT.read_text())

payloads = st.binary(min_size=1, max_size=MAX_PAYLOAD)
lines = st.one_of(
    st.binary(max_size=120),
    st.lists(st.integers(0, 6), max_size=120).map(bytes),
    st.lists(st.one_of(payloads.map(frame), st.binary(max_size=40)), max_size=6).map(b"".join),
)


def test_the_crc_is_the_catalogues() -> None:
    assert crc16(np.frombuffer(bytearray(b"123456789"), np.uint8), 9) == 0x29B1


def test_the_document_has_vectors_of_every_message() -> None:
    assert {bytes.fromhex(payload)[0] for _, payload, _, _ in VECTORS} == {1, 2, 3, 4, 5, 0x81, 0x82, 0x83, 0x84}


@pytest.mark.parametrize(("what", "payload", "crc", "wire"), VECTORS)
def test_a_vector_of_the_document(what: str, payload: str, crc: str, wire: str) -> None:
    raw, coded = bytes.fromhex(payload), bytes.fromhex(wire)
    assert frame(raw) == coded
    assert reference.framed(raw) == coded
    assert Decoder().feed(coded) == [raw]
    assert crc16(np.frombuffer(bytearray(raw), np.uint8), len(raw)) == int(crc, 16)


@given(payloads)
def test_a_frame_is_read_by_the_reference_and_by_its_own_decoder(payload: bytes) -> None:
    coded = frame(payload)
    assert coded == reference.framed(payload)
    assert len(coded) == len(payload) + 4
    assert coded.index(0) == len(coded) - 1
    assert reference.payloads(coded) == Decoder().feed(coded) == [payload]


@given(lines)
def test_any_line_gives_what_the_reference_finds(line: bytes) -> None:
    assert Decoder().feed(line) == reference.payloads(line)


@given(lines, st.data())
def test_where_the_line_is_cut_into_reads_does_not_matter(line: bytes, data: st.DataObject) -> None:
    cut = data.draw(st.integers(0, len(line)))
    decoder = Decoder()
    assert [*decoder.feed(line[:cut]), *decoder.feed(line[cut:])] == reference.payloads(line)


@given(st.binary(max_size=200), payloads)
def test_after_garbage_the_next_zero_ends_the_damage(garbage: bytes, payload: bytes) -> None:
    decoder = Decoder()
    decoder.feed(garbage)
    assert decoder.feed(b"\0" + frame(payload))[-1:] == [payload]


@given(payloads, st.data())
def test_a_flipped_bit_of_payload_or_crc_is_refused(payload: bytes, data: st.DataObject) -> None:
    plain = bytearray(reference.unstuffed(frame(payload)[:-1]) or b"")
    bit = data.draw(st.integers(0, 8 * len(plain) - 1))
    plain[bit // 8] ^= 1 << bit % 8
    coded = b"".join(bytes([len(piece) + 1]) + piece for piece in bytes(plain).split(b"\0"))
    decoder = Decoder()
    assert decoder.feed(coded + b"\0") == []
    assert decoder.bad_crc == 1


def test_what_is_refused_is_counted_by_its_reason() -> None:
    decoder = Decoder()
    assert decoder.feed(b"\0\0") == []
    assert (decoder.bad_coding, decoder.bad_crc) == (0, 0)
    assert decoder.feed(b"\x05ab\0" + b"\x24" + b"x" * 35 + b"\0" + b"\x01\x01\0") == []
    assert (decoder.bad_coding, decoder.bad_crc) == (3, 0)


@pytest.mark.parametrize("size", [0, MAX_PAYLOAD + 1])
def test_a_payload_of_no_length_is_no_frame(size: int) -> None:
    with pytest.raises(ValueError, match=rf"{size} bytes; a frame takes 1 … 32"):
        frame(bytes(size))
