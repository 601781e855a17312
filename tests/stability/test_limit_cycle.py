from __future__ import annotations

import math

import numpy as np
import pytest

from hapticd.stability.describing_function import (
    balance,
    limit_cycles,
    predicted_cycle,
    settled_cycle,
    small_amplitude,
    small_sigma,
)
from hapticd.stability.numbers import Dimensionless, Loop

from .locked_cycle import locked_cycles
from .motion import simulate


def test_the_small_cycle_of_eq_68_is_found_and_stable() -> None:
    omega, mu, beta = 1.3, 100.0, 0.75
    n = Dimensionless(mu, beta, float(small_sigma(beta, omega, mu, 0.5)))
    (cycle,) = limit_cycles(n)
    assert cycle.stable
    assert cycle.omega == pytest.approx(omega, rel=1e-9)
    assert cycle.amplitude == pytest.approx(float(small_amplitude(omega, mu, 0.5)), rel=1e-9)
    assert predicted_cycle(n) == cycle


def test_the_large_cycle_is_unstable_and_guards_region_d() -> None:
    n = Dimensionless(100.0, 0.3, 1.0)
    (cycle,) = limit_cycles(n)
    assert not cycle.stable
    # (72), D ≈ 1
    w = cycle.omega
    assert cycle.amplitude == pytest.approx(4.0 / (math.pi * (math.sin(0.5 * w) - 0.3 * w)), rel=2e-3)
    assert predicted_cycle(n) is None
    assert settled_cycle(n, 10.0) is None
    # the average case is milder than the worst case: exact simulation agrees with the unstable cycle within 15 %
    assert simulate(n, 0.85 * cycle.amplitude, 0.0, 20_000).at_rest
    assert simulate(n, 1.15 * cycle.amplitude, 0.0, 20_000).grew


def test_region_a_has_none_and_no_spring_has_none() -> None:
    assert limit_cycles(Dimensionless(100.0, 0.9, 0.7)) == []
    assert predicted_cycle(Loop(1.0, 0.0, 0.0, 0.0, 1.0, 1.0).numbers) is None


def test_near_the_edge_of_region_b_cycles_reach_many_ticks() -> None:
    cycles = limit_cycles(Dimensionless(100.0, 0.505, 0.0))
    stable = [c.amplitude for c in cycles if c.stable]
    assert len(stable) > 4
    assert max(stable) > 5.0
    assert [c.stable for c in cycles] == [i % 2 == 0 for i in range(len(cycles))]
    assert settled_cycle(Dimensionless(100.0, 0.505, 0.0), 4.0) == cycles[6]


@pytest.mark.parametrize("point", [(100.0, 0.505, 0.0, 0.0), (5.0, 0.1, 0.3, 0.0), (100.0, 1.2, 0.2, 1.25)])
def test_every_cycle_is_a_zero_of_the_net_gain(point: tuple[float, float, float, float]) -> None:
    n = Dimensionless(*point)
    for cycle in limit_cycles(n):
        omega, gain = balance(cycle.amplitude, n)
        assert float(gain) == pytest.approx(0.0, abs=1e-9)
        assert float(omega) == pytest.approx(cycle.omega, rel=1e-9)


def test_case_b_of_fig_8_locks_to_nine_periods() -> None:
    # notes: 0.0093 coarse tick = 20 raw counts at 55 Hz, locked to a whole number of periods
    loop = Loop(6.28e-6, 9e-6, 2e-3, 0.012, 2172 * 2.0 * math.pi / 8192, 1e-3)
    nine = next(c for c in locked_cycles(loop.numbers) if c.half_period == 9)
    assert nine.amplitude == pytest.approx(0.0093, abs=5e-5)
    assert 2172 * nine.amplitude == pytest.approx(20.0, abs=0.2)
    assert loop.scales.omega_to_hz(nine.omega) == pytest.approx(55.0, abs=1.0)


def test_describing_function_finds_a_cycle_among_the_locked_ones() -> None:
    for sigma in (0.1, 0.2, 0.3, 0.4):
        n = Dimensionless(100.0, 0.75, sigma)
        cycle = predicted_cycle(n)
        assert cycle is not None
        periods = [c.half_period for c in locked_cycles(n)]
        assert min(periods) <= math.pi / cycle.omega <= max(periods)


def test_frictionless_relay_in_closed_form() -> None:
    # β = σ = 0: parabolas of acceleration ±1/(2μ) over p periods, half of peak to peak p²/(16μ)
    for cycle in locked_cycles(Dimensionless(100.0, 0.0, 0.0, 0.3)):
        assert cycle.amplitude == pytest.approx(cycle.half_period**2 / 1600.0, rel=1e-9)


@pytest.mark.parametrize("tau_d", [0.0, 0.25])
@pytest.mark.parametrize("sigma", [0.0, 0.2, 0.3])
def test_simulated_cycles_are_locked_ones(sigma: float, tau_d: float) -> None:
    n = Dimensionless(100.0, 0.9, sigma, tau_d)
    positions = np.array(simulate(n, 0.0, 0.05, 6_000).samples)[-2_000:, 0]
    turns = np.flatnonzero((positions[:-1] < 0.0) & (positions[1:] >= 0.0))
    half_period = float(np.mean(np.diff(turns))) / 2.0
    cycle = min(locked_cycles(n), key=lambda c: abs(c.half_period - half_period))
    assert cycle.half_period == pytest.approx(half_period, abs=1e-9)
    # samples miss the peak by at most half a period of motion at the peak's acceleration
    sampled = 0.5 * float(np.ptp(positions))
    assert sampled <= cycle.amplitude * (1 + 1e-3)
    assert sampled == pytest.approx(cycle.amplitude, abs=0.25 * (0.5 + sigma) / n.mu)


def test_no_locked_cycle_where_stiction_holds_one_tick() -> None:
    assert locked_cycles(Dimensionless(100.0, 0.9, 0.5)) == []
