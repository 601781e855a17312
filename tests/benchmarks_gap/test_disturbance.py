"""The coloured torque: its law, its independence of everything else, and that it reaches the shaft."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.gap import disturbance
from benchmarks.gap.disturbance import CORRELATION_S, SHARES, STEP_S, Coloured, disturbed, drawn
from benchmarks.gap.generate import generate, visibility
from benchmarks.gap.physics import Device, accelerations, torque_from_outside

COULOMB = 2e-3
DEVICE = Device(inertia=6e-6, viscous=0.0, coulomb=COULOMB, torque_constant=0.03, delay_s=0.0, resolution=1e-3)


@pytest.mark.parametrize("correlation_s", CORRELATION_S)
def test_it_has_the_standard_deviation_and_correlation_time_asked_for(correlation_s: float) -> None:
    std, duration = 3e-4, 20_000 * correlation_s
    torque = drawn(std, correlation_s, duration, 1)
    assert np.std(torque) == pytest.approx(std, rel=4.0 / math.sqrt(20_000))
    lag = round(correlation_s / STEP_S)
    assert np.mean(torque[lag:] * torque[:-lag]) / std**2 == pytest.approx(
        math.exp(-lag * STEP_S / correlation_s), abs=0.04
    )


def test_the_first_value_is_of_the_same_law() -> None:
    first = [drawn(1.0, 0.2, 0.001, seed)[0] for seed in range(400)]
    assert np.std(first) == pytest.approx(1.0, rel=0.15)
    assert np.mean(first) == pytest.approx(0.0, abs=0.2)


def test_it_is_linear_between_its_steps_and_accelerates_the_shaft() -> None:
    held = disturbed(DEVICE, Coloured(0.25, 0.05), COULOMB, 1.0, 3)
    between = torque_from_outside(held, 10.25 * STEP_S)
    assert between == pytest.approx(0.75 * held.coloured[10] + 0.25 * held.coloured[11], rel=1e-12)
    assert torque_from_outside(held, 99.0) == held.coloured[-1]
    sliding = (between - COULOMB) / DEVICE.inertia
    assert accelerations(held, 10.25 * STEP_S, 0.0, 1.0, 0, 0, 0, 0.0, 1.0)[0] == pytest.approx(sliding, rel=1e-12)
    assert disturbed(DEVICE, None, COULOMB, 1.0, 3) is DEVICE


def test_the_session_is_the_same_with_and_without_it() -> None:
    plain = generate([], 3, 3.0)
    loud = generate([], 3, 3.0, coloured=Coloured(SHARES[1], 0.05))
    np.testing.assert_array_equal(loud.time_s, plain.time_s)
    np.testing.assert_array_equal(loud.origin_counts, plain.origin_counts)
    assert not np.array_equal(loud.counts, plain.counts)
    again = generate([], 3, 3.0, coloured=Coloured(SHARES[1], 0.05))
    np.testing.assert_array_equal(again.counts, loud.counts)
    assert visibility(loud) < 1e-2
    assert visibility(loud, knows_coloured=False) > 0.3


def test_it_is_none_of_what_was_recorded() -> None:
    """Two sessions of other seeds do not share it, and it does not depend on what is hidden."""
    first, other = (drawn(1.0, 0.05, 20.0, seed) for seed in (1, 2))
    assert abs(np.corrcoef(first, other)[0, 1]) < 4.0 * math.sqrt(2.0 * 0.05 / 20.0)
    bare = generate([], 3, 2.0, coloured=Coloured(0.25, 0.05))
    hidden = generate([{"name": "constant_bias", "tau_0": 5e-4}], 3, 2.0, coloured=Coloured(0.25, 0.05))
    np.testing.assert_array_equal(hidden.device.coloured, bare.device.coloured)
    assert disturbance.STEP_S <= 1e-3
