"""The converter's grid: rint(i/q) with q = 2·FS/2^bits, two's-complement ends."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.plant.amplifier import converter_grid, quantise_current

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
    assert converter_grid(14, 6.0) == (Q14, 8191)
    assert quantise_current(current, Q14, 8191) == (code * Q14, code)


@given(
    st.floats(allow_nan=False, allow_infinity=False), st.integers(1, 24), st.sampled_from([6.0, 1.0, 0.3, 10.0, 7.77])
)
def test_quantising_twice_changes_nothing(current: float, bits: int, full_scale: float) -> None:
    grid = converter_grid(bits, full_scale)
    once = quantise_current(current, *grid)
    assert quantise_current(once[0], *grid) == once


@given(st.floats(-6.0, 5.999), st.integers(2, 24))
def test_inside_the_scale_the_error_is_at_most_half_a_step(current: float, bits: int) -> None:
    step = 12.0 / 2**bits
    quantised, code = quantise_current(current, *converter_grid(bits, 6.0))
    assert abs(quantised - current) <= (0.5 * step if code < 2 ** (bits - 1) - 1 else step) * (1 + 1e-12)


@pytest.mark.parametrize(("bits", "full_scale"), [(0, 6.0), (14, 0.0), (None, 6.0), (14, None)])
def test_an_ideal_converter_has_no_grid_and_no_end(bits: int | None, full_scale: float | None) -> None:
    assert converter_grid(bits, full_scale) == (0.0, 0)
    assert quantise_current(1.234567, *converter_grid(bits, full_scale)) == (1.234567, 0)
