"""The root that every limit of the theory is found by."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.stability.boundary import boundary


@settings(max_examples=100, deadline=None)
@given(edge=st.floats(1e-9, 1e9), is_sign=st.booleans(), rises=st.booleans())
def test_the_last_value_that_holds(edge: float, is_sign: bool, rises: bool) -> None:
    def margin(value: float) -> float:
        left = value - edge if rises else edge - value
        return math.copysign(1.0, left) if is_sign else left

    good, bad = (2.0 * edge, 0.0) if rises else (0.0, 2.0 * edge)
    assert boundary(margin, good, bad) == edge


def test_a_margin_that_is_infinite_at_nothing() -> None:
    found = boundary(lambda stiffness: 1.0 / stiffness - 3.0 if stiffness else math.inf, 0.0, 7.0)
    assert found == pytest.approx(1.0 / 3.0, rel=1e-15)
    assert 1.0 / found >= 3.0 > 1.0 / math.nextafter(found, 7.0)


def test_no_change_of_sign() -> None:
    with pytest.raises(ValueError, match="different signs"):
        boundary(lambda _: 1.0, 0.0, 1.0)
