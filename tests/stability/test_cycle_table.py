from __future__ import annotations

import math

import pytest

from benchmarks.cycles import summarise
from hapticd.stability.cycle_table import Row, cycle_table
from hapticd.stability.limit_cycle import predicted_cycle
from hapticd.stability.locked_cycle import locked_cycles
from hapticd.stability.numbers import Dimensionless


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    sigmas = (0.0, 0.1, 0.2, 0.3, 0.4)
    return cycle_table(betas=(0.2, 0.45, 0.55, 0.75, 1.2), sigmas=sigmas, delays=(0.0,), periods=30_000)


def test_both_regions_are_covered(rows: list[Row]) -> None:
    assert [row.region for row in rows] == ["C"] * 10 + ["B"] * 15
    assert all(row.outcome in ("persistent", "growing") for row in rows)
    assert all(row.outcome == "persistent" for row in rows if row.region == "B")


def test_errors_are_of_the_prediction_against_the_simulation(rows: list[Row]) -> None:
    for row in rows:
        predicted = predicted_cycle(Dimensionless(100.0, row.beta, row.sigma))
        assert row.predicted == predicted
        if predicted is not None and row.outcome == "persistent":
            assert row.amplitude * (1.0 + row.amplitude_error) == pytest.approx(predicted.amplitude)
            assert row.omega * (1.0 + row.frequency_error) == pytest.approx(predicted.omega)


def test_a_row_agrees_within_the_tolerances_or_says_why_not(rows: list[Row]) -> None:
    for row in rows:
        if math.isfinite(row.amplitude_error):
            assert row.agrees == (abs(row.amplitude_error) <= 0.15 and abs(row.frequency_error) <= 0.10)
        assert bool(row.why) != row.agrees
    agreeing = [(row.beta, row.sigma) for row in rows if row.region == "B" and row.agrees]
    assert len(agreeing) >= 2


def test_exact_cycles_explain_what_the_describing_function_misses(rows: list[Row]) -> None:
    inside = [row for row in rows if row.region == "B"]
    assert sum(row.locked is not None for row in inside) >= 0.8 * len(inside)
    for row in inside:
        if row.locked is not None:
            assert row.locked in locked_cycles(Dimensionless(100.0, row.beta, row.sigma))
            assert row.locked.amplitude == pytest.approx(row.amplitude, rel=0.02)
            if not row.agrees:
                assert f"locked to {2 * row.locked.half_period} periods" in row.why


def test_where_no_cycle_is_predicted_growth_agrees_and_a_cycle_does_not(rows: list[Row]) -> None:
    (small,) = (row for row in rows if (row.beta, row.sigma) == (0.2, 0.0))
    assert (small.predicted, small.outcome, small.agrees) == (None, "persistent", False)
    assert small.why.startswith("no stable cycle is predicted")
    (fast,) = cycle_table(betas=(0.2,), sigmas=(0.0,), delays=(0.0,), xi_dot_0=5.0, periods=30_000)
    assert (fast.predicted, fast.outcome, fast.agrees, fast.why) == (None, "growing", True, "")


def test_the_summary_counts_the_rows(rows: list[Row]) -> None:
    summary = summarise(rows, "B")
    inside = [row for row in rows if row.region == "B"]
    assert (summary.points, summary.oscillating) == (15, 15)
    assert summary.agree == sum(row.agrees for row in inside)
    assert summary.amplitude_within == sum(abs(row.amplitude_error) <= 0.15 for row in inside) / 15
    assert math.isnan(summarise([], "B").amplitude_within)


def test_regions_without_cycles_are_refused() -> None:
    with pytest.raises(ValueError, match=r"0 <= sigma < 0.5"):
        cycle_table(sigmas=(0.2, 0.5))
