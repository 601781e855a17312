"""The converter's grid: rint(i/q) with q = 2·FS/2^bits, two's-complement ends."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.plant.amplifier import dac_quantise, quantise_current

Q14 = 12.0 / 2**14


@pytest.mark.parametrize(
    ("current", "code"),
    [
        (0.0, 0),
        (-0.0, 0),
        (0.49 * Q14, 0),
        (0.51 * Q14, 1),
        (-0.51 * Q14, -1),
        (1.5 * Q14, 2),
        (2.5 * Q14, 2),
        (1.0, 1365),
        (-1.0, -1365),
        (6.0, 8191),
        (-6.0, -8192),
        (1e300, 8191),
        (-1e300, -8192),
        (math.inf, 8191),
        (-math.inf, -8192),
        (math.nan, 0),
    ],
)
def test_fourteen_bits_over_six_amperes(current: float, code: int) -> None:
    assert dac_quantise(current, 14, 6.0) == (code * Q14, code)
    assert quantise_current(current, Q14, 8191) == (code * Q14, code)


@given(
    st.floats(allow_nan=False, allow_infinity=False), st.integers(1, 24), st.sampled_from([6.0, 1.0, 0.3, 10.0, 7.77])
)
def test_quantising_twice_changes_nothing(current: float, bits: int, full_scale: float) -> None:
    once = dac_quantise(current, bits, full_scale)
    assert dac_quantise(once[0], bits, full_scale) == once


@given(st.floats(-6.0, 5.999), st.integers(2, 24))
def test_inside_the_scale_the_error_is_at_most_half_a_step(current: float, bits: int) -> None:
    step = 12.0 / 2**bits
    quantised, code = dac_quantise(current, bits, 6.0)
    assert abs(quantised - current) <= (0.5 * step if code < 2 ** (bits - 1) - 1 else step) * (1 + 1e-12)


@pytest.mark.parametrize(
    ("current", "full_scale", "expected"),
    [(1.234567, 6.0, 1.234567), (7.0, 6.0, 6.0), (-7.0, 6.0, -6.0), (7.0, 0.0, 7.0), (-1e9, 0.0, -1e9)],
)
def test_no_bits_is_an_ideal_converter_that_only_clips(current: float, full_scale: float, expected: float) -> None:
    assert dac_quantise(current, 0, full_scale) == (expected, 0)
