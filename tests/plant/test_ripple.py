"""The torque of a ripple over a way: all orders at once where it is short, the library's sines where it is long."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hapticd.plant.effect_terms import field_torque
from hapticd.plant.layout import SIZE, index_of

ORDERS = (1.0, 7.0, 12.0, 84.0)
AMPLITUDES = (0.3, 1.0, 0.0, 0.2)
PHASES = (0.3, -2.0, 1.0, 9.0)


def vector(count: int) -> np.ndarray:
    p = np.zeros(SIZE)
    for name, values in (("orders", ORDERS), ("amplitudes", AMPLITUDES), ("phases", PHASES)):
        first = index_of(f"torque_ripple.{name}")
        p[first : first + count] = values[:count]
    return p


@pytest.mark.parametrize("count", [1, 2, 4])
@pytest.mark.parametrize("way", [0.0, 1e-9, 1e-3, 0.02, 0.0301, 0.0304, 0.2, 3.0])
def test_a_ripple_is_its_mean_over_the_way(count: int, way: float) -> None:
    """Of nodes so close that their mean is exact; around ways of a quarter turn of the orders' sum the branch changes."""
    p = vector(count)
    nodes, weights = np.polynomial.legendre.leggauss(120)
    for start in np.random.default_rng(5).uniform(-40.0, 40.0, 50):
        for end in (start + way, start - way):
            at = 0.5 * (start + end) + 0.5 * (end - start) * nodes
            expected = sum(
                a * float(0.5 * weights @ np.sin(k * at + phase))
                for k, a, phase in zip(ORDERS[:count], AMPLITUDES[:count], PHASES[:count], strict=True)
            )
            assert field_torque(p, start, end, 0.0, 0.0, 0.0) == pytest.approx(expected, abs=3e-12)


@pytest.mark.parametrize("position", [math.nan, math.inf])
def test_what_is_no_position_comes_through(position: float) -> None:
    assert math.isnan(field_torque(vector(4), position, position, 0.0, 0.0, 0.0))
