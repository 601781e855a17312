"""The range of an inertia, of shafts that a balance with friction alone gets wrong; semi-implicit steps of 20 µs."""

from __future__ import annotations

import math
from dataclasses import replace

import numba
import numpy as np
import pytest

from hapticd.gap.balance import balance
from hapticd.gap.inertia_range import inertia_range
from hapticd.gap.recording import Recording

PERIOD_S, STEPS, ROWS, CELL = 2e-3, 100, 10_000, 1e-4
INERTIA, VISCOUS, COULOMB, WEIGHT = 0.05, 0.02, 0.05, 1.5


@numba.njit
def _played(torque: np.ndarray, weight: float, ripple: float, fades: float) -> np.ndarray:
    found = np.empty(torque.size)
    h = PERIOD_S / STEPS
    x = v = 0.0
    for k in range(torque.size):
        found[k] = x
        for _ in range(STEPS):
            friction = COULOMB * (1.0 + fades * math.exp(-abs(v) / 0.3)) * math.tanh(v / 1e-3) + VISCOUS * v
            v += h * (torque[k] - weight * math.sin(x) - ripple * math.sin(7.0 * x) - friction) / INERTIA
            x += h * v
    return found


def recorded(seed: int, weight: float, ripple: float, fades: float) -> Recording:
    """Twenty seconds of smooth noise as torque, and a torque that nobody recorded, a hundredth of it."""
    rng = np.random.default_rng(seed)
    smooth = np.exp(-0.5 * (np.arange(-400, 401) * PERIOD_S / 0.1) ** 2)
    known, unknown = (np.convolve(rng.normal(size=ROWS + 800), smooth, "valid")[:ROWS] for _ in range(2))
    torque = 0.8 * known / known.std()
    x = _played(torque + 8e-3 * unknown / unknown.std(), weight, ripple, fades)
    return Recording(
        "shaft", PERIOD_S * np.arange(ROWS), np.floor(x / CELL) * CELL, CELL, torque, None, PERIOD_S, False
    )


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(
    ("weight", "ripple", "fades"), [(WEIGHT, 0.0, 0.0), (0.0, 0.3, 0.0), (WEIGHT, 0.0, 1.0), (0.0, 0.0, 1.0)],
    ids=["pendulum", "cogging", "pendulum-stribeck", "stribeck"],
)  # fmt: skip
def test_the_inertia_is_in_its_range(weight: float, ripple: float, fades: float, seed: int) -> None:
    recording = recorded(seed, weight, ripple, fades)
    found = inertia_range([recording], 1.0)
    assert 0.0 < found.low <= 1.05 * INERTIA
    assert found.high >= 0.95 * INERTIA
    assert found.high < 1.4 * found.low
    if weight:  # what acceleration and place have in common is no inertia
        assert balance([recording], 1.0).inertia < 0.8 * found.low


def test_what_moves_by_itself_has_a_wide_range() -> None:
    """A current that has nothing to do with the motion says of the inertia only that nothing is known."""
    recording = recorded(4, 0.0, 0.0, 0.0)
    other = np.random.default_rng(5).permutation(recording.current)
    found = inertia_range([replace(recording, current=other)], 1.0)
    assert found.high > 10.0 * found.low
