"""The bounds of Sec. VI: (40) always holds, (47) and (58) do not, the corrected and the sharp ones do."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.stability.bounds import CRITERIA, Bounds, check_bounds, generated, generation_bound
from hapticd.stability.ledger import Ledger, ledger
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.sharp import mean_error
from hapticd.stability.storage import FloatArray, potential

POINTS = st.builds(
    Dimensionless,
    mu=st.floats(1.0, 1e4),
    beta=st.floats(0.0, 1.5),
    sigma=st.floats(0.0, 3.0),
    tau_d=st.sampled_from([0.0, 0.07, 0.5, 1.0, 1.25, 2.0]),
)


def checked(account: Ledger) -> tuple[Bounds, int]:
    return check_bounds(account), int(account.coasts)


def friction_bound(account: Ledger) -> FloatArray:
    """(40): β D²/(τ₁ − τ₀) + σ|D|."""
    way, duration = np.diff(account.xi), np.diff(account.tau)
    return account.numbers.beta * way * way / duration + account.numbers.sigma * np.abs(way)


@settings(max_examples=200, deadline=None)
@given(POINTS, st.floats(-4.0, 4.0), st.floats(-8.0, 8.0))
def test_friction_and_corrected_bounds_hold_at_every_moment(numbers: Dimensionless, xi: float, xi_dot: float) -> None:
    account = ledger(numbers, xi, xi_dot, 40)
    bounds, first = checked(account)
    dissipated = account.dissipated[first:]
    assert np.all(dissipated - friction_bound(account)[first:] >= -1e-12 * (1.0 + dissipated))
    assert bounds.violations("corrected").size == 0
    assert bounds.violations("sharp").size == 0
    assert bounds.generated == pytest.approx(account.generated[first:], rel=1e-9, abs=1e-9 * bounds.scale.max())


@settings(max_examples=150, deadline=None)
@given(POINTS, st.floats(-4.0, 4.0), st.floats(-8.0, 8.0), st.integers(0, 20))
def test_the_worst_moment_is_found(numbers: Dimensionless, xi: float, xi_dot: float, k: int) -> None:
    account = ledger(numbers, xi, xi_dot, 25)
    bounds, first = checked(account)
    k = min(k, bounds.way.size - 1)
    start, sampled = account.xi[first + k], account.sampled[first + k]
    low, high = account.low[first + k], account.high[first + k]
    ways = np.linspace(low - start, high - start, 3001)
    grain = (high - low) / 3000.0 * 2.0 * (2.0 + abs(start - sampled) + (high - low))
    for criterion in CRITERIA:
        tried = max(
            0.0, float((generated(sampled, start, ways) - generation_bound(ways, start - sampled, criterion)).max())
        )
        slack = 1e-9 * bounds.scale[k]
        assert tried - slack <= bounds.excess[criterion][k] <= tried + grain + slack


def test_the_papers_bound_fails_beside_an_edge_and_by_how_much() -> None:
    bounds, _ = checked(ledger(Dimensionless(100.0, 0.51, 0.51), 0.99, 0.5, 1))
    assert bounds.violations("paper").tolist() == [0]
    # E_g = D − 0.01 once the edge is crossed; less ½D² + ½D that is largest at D = ½, beyond the end of the period
    D = bounds.way[0]
    assert bounds.excess["paper"][0] == pytest.approx(D - 0.01 - 0.5 * D * D - 0.5 * D, rel=1e-12)
    assert bounds.excess["sharp"][0] == 0.0


def test_with_delay_the_papers_bound_fails_too() -> None:
    bounds, _ = checked(ledger(Dimensionless(1e4, 0.3, 0.6, 0.5), 0.49, 0.3, 40))
    assert bounds.violations("paper").size > 0
    assert bounds.violations("corrected").size == 0


def test_bounds_in_numbers() -> None:
    assert generation_bound(-2.0, 0.3) == pytest.approx(2.0 + 0.8 * 2.0)
    assert generation_bound(2.0, 0.3, "corrected") == pytest.approx(2.0 + 1.3 * 2.0)
    assert generation_bound(2.5, 0.3, "sharp") == pytest.approx(2.5 * (float(mean_error(2.5)) + 0.3))
    assert generation_bound(2.5, -0.3, "sharp") == pytest.approx(2.5 * float(mean_error(2.5)))


@settings(max_examples=200, deadline=None)
@given(st.floats(-50.0, 50.0), st.floats(-3.0, 3.0), st.floats(-20.0, 20.0))
def test_generated_energy_in_closed_form(sampled: float, late: float, way: float) -> None:
    start = sampled + late
    direct = -(np.floor(sampled) + 0.5) * way + float(potential(start + way) - potential(start))
    assert generated(sampled, start, way) == pytest.approx(direct, abs=1e-9)


def test_the_sharp_bound_is_reached_just_below_an_edge() -> None:
    ways = np.linspace(0.01, 5.0, 200)
    reached = generated(-1e-9, -1e-9, ways)
    assert reached == pytest.approx(generation_bound(ways, 0.0, "sharp"), abs=1e-7)
    assert np.all(reached[ways > 0.01] > generation_bound(ways[ways > 0.01], 0.0, "paper") - 1e-7)
