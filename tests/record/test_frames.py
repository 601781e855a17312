"""Frames of a live view: what goes in comes out, to four bytes a value, and what is no frame is refused."""

import numpy as np
import pytest

from hapticd.record.frames import HEADER, ROW_BYTES, Context, decode, encode, standing
from hapticd.record.schema import FLAG_CLAMPED, FLAG_FAULT, FLAG_RUNNING, empty_rows

CONTEXT = Context(first_row=2**40, epoch=7, decimation=217, period_s=5e-5, origin_counts=-(2**35), unix_s=1.7e9)


def some_rows(count: int = 400) -> np.ndarray:
    rows = empty_rows(count)
    rows["tick"] = 2**33 + np.arange(count) + (np.arange(count) > 100) * 3
    rows["time_s"] = 86400.0 + np.arange(count) * 5e-5
    rows["encoder_counts"] = CONTEXT.origin_counts + np.arange(count) - 200
    rows["ticks"] = np.arange(count) // 3
    rows["current_command_A"] = np.linspace(-1, 1, count)
    rows["current_measured_A"] = np.nan
    rows["force_command"] = 0.25
    rows["wake_late_ns"] = 12_000
    rows["flags"] = FLAG_RUNNING
    return rows


def test_a_frame_gives_its_rows_back() -> None:
    rows = some_rows()
    frame = encode(rows, CONTEXT)
    assert len(frame) == HEADER.size + ROW_BYTES * len(rows)
    back, context = decode(frame)
    assert context == CONTEXT
    for name in ("tick", "encoder_counts", "ticks", "flags", "wake_late_ns"):
        np.testing.assert_array_equal(back[name], rows[name])
    np.testing.assert_allclose(back["time_s"], rows["time_s"], rtol=0, atol=1e-8)
    np.testing.assert_allclose(back["current_command_A"], rows["current_command_A"], rtol=1e-7)
    assert np.isnan(back["current_measured_A"]).all()


def test_a_sign_of_life_has_no_rows() -> None:
    rows, context = decode(encode(empty_rows(), CONTEXT))
    assert len(rows) == 0
    assert context.unix_s == CONTEXT.unix_s


def test_where_the_loop_stands_is_told_without_decoding() -> None:
    rows = some_rows()
    rows["flags"][-1] = FLAG_FAULT | FLAG_CLAMPED
    assert standing(encode(rows[:-1], CONTEXT)) == (CONTEXT.epoch, FLAG_RUNNING)
    assert standing(encode(rows, CONTEXT)) == (CONTEXT.epoch, FLAG_FAULT)
    assert standing(encode(empty_rows(), CONTEXT)) is None
    assert standing(b"") is None


def test_what_does_not_fit_stands_at_the_end_of_the_range() -> None:
    rows = some_rows(2)
    rows["encoder_counts"] = [2**60, -(2**60)]
    back, _ = decode(encode(rows, CONTEXT))
    np.testing.assert_array_equal(back["encoder_counts"] - CONTEXT.origin_counts, [2**31 - 1, -(2**31)])


def test_large_forces_are_infinite_and_no_warning() -> None:
    rows = some_rows(1)
    rows["force_command"] = 1e300
    assert np.isinf(decode(encode(rows, CONTEXT))[0]["force_command"][0])


@pytest.mark.parametrize("frame", [b"", b"x" * 64, encode(some_rows(), CONTEXT)[:-1]])
def test_what_is_no_frame_is_refused(frame: bytes) -> None:
    with pytest.raises(ValueError, match="frame"):
        decode(frame)
