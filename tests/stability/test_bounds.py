"""The bounds of Sec. VI: (40) always holds; (47) and (58) of S, and not of H_T."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.stability.bounds import Bounds, check_bounds, generation_bound
from hapticd.stability.ledger import Ledger, generated, ledger
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.storage import FloatArray, potential, rho

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
def test_friction_and_the_bound_on_s_hold_at_every_moment(numbers: Dimensionless, xi: float, xi_dot: float) -> None:
    account = ledger(numbers, xi, xi_dot, 40)
    bounds, first = checked(account)
    dissipated = account.dissipated[first:]
    assert np.all(dissipated - friction_bound(account)[first:] >= -1e-12 * (1.0 + dissipated))
    start, sampled = account.xi[first:-1], account.sampled[first:]
    for end in (account.low[first:], account.high[first:], account.xi[first + 1 :]):
        received = 0.5 * (end * end - start * start) - (np.floor(sampled) + 0.5) * (end - start)
        assert np.all(received <= generation_bound(end - start, start - sampled) + 1e-9 * bounds.scale)
    direct = account.force[first:] * bounds.displacement + np.diff(potential(account.xi[first:]))
    assert bounds.generated == pytest.approx(direct, rel=1e-9, abs=1e-9 * bounds.scale.max())


@settings(max_examples=150, deadline=None)
@given(POINTS, st.floats(-4.0, 4.0), st.floats(-8.0, 8.0), st.integers(0, 20))
def test_the_worst_moment_is_found(numbers: Dimensionless, xi: float, xi_dot: float, k: int) -> None:
    account = ledger(numbers, xi, xi_dot, 25)
    bounds, first = checked(account)
    k = min(k, bounds.displacement.size - 1)
    start, sampled = account.xi[first + k], account.sampled[first + k]
    low, high = account.low[first + k], account.high[first + k]
    ways, late = np.linspace(low - start, high - start, 3001), np.floor(start) - np.floor(sampled)
    grain = (high - low) / 3000.0 * 2.0 * (2.0 + abs(start - sampled) + (high - low))
    tried = max(0.0, float((generated(late, rho(start), ways) - generation_bound(ways, start - sampled)).max()))
    slack = 1e-9 * bounds.scale[k]
    assert tried - slack <= bounds.excess[k] <= tried + grain + slack


def test_the_papers_bound_fails_beside_an_edge_and_by_how_much() -> None:
    bounds, _ = checked(ledger(Dimensionless(100.0, 0.51, 0.51), 0.99, 0.5, 1))
    assert bounds.violations.tolist() == [0]
    # E_g = D − 0.01 once the edge is crossed; less ½D² + ½D that is largest at D = ½, beyond the end of the period
    D = bounds.displacement[0]
    assert bounds.excess[0] == pytest.approx(D - 0.01 - 0.5 * D * D - 0.5 * D, rel=1e-12)


def test_with_delay_the_papers_bound_fails_too() -> None:
    bounds, _ = checked(ledger(Dimensionless(1e4, 0.3, 0.6, 0.5), 0.49, 0.3, 40))
    assert bounds.violations.size > 0


def test_bounds_in_numbers() -> None:
    assert generation_bound(-2.0, 0.3) == pytest.approx(2.0 + 0.8 * 2.0)


@settings(max_examples=200, deadline=None)
@given(st.floats(-50.0, 50.0), st.floats(-3.0, 3.0), st.floats(-20.0, 20.0))
def test_generated_energy_in_closed_form(sampled: float, late: float, way: float) -> None:
    start = sampled + late
    direct = -(np.floor(sampled) + 0.5) * way + float(potential(start + way) - potential(start))
    found = generated(np.floor(start) - np.floor(sampled), rho(start), np.asarray(way))
    assert found == pytest.approx(direct, abs=1e-9)
