from __future__ import annotations

import pytest

from hapticd.config import load_config
from hapticd.stability.devices import HUMAN_OPERATOR, TABLE_II, Comparison, Hand, compare, grip_fraction, rounding
from hapticd.stability.numbers import from_config
from hapticd.stability.regions import region

ROWS: dict[tuple[str, str], Comparison] = {(d.slug, c.quantity): c for d in TABLE_II for c in compare(d)}


def test_recomputed_by_hand() -> None:
    # notes: Impulse Engine 1000, 0.125, 0.955; Toolhandle 38.08; Phantom 70.9, 0.0049; Freedom 6 β 0.0042
    expected = {
        ("impulse_engine", "mu"): 1000.0,
        ("impulse_engine", "beta"): 0.125,
        ("impulse_engine", "sigma"): 0.955,
        ("mit_toolhandle", "mu"): 38.08,
        ("phantom", "mu"): 70.9,
        ("phantom", "beta"): 0.0049,
        ("freedom6", "beta"): 0.0042,
        ("delta", "mu"): 155.2,
        ("omega", "mu"): 136.6,
    }
    for key, value in expected.items():
        assert ROWS[key].recomputed == pytest.approx(value, rel=1e-2), key


def test_only_freedom_6_is_not_a_matter_of_rounding() -> None:
    assert [key for key, row in ROWS.items() if not row.explained] == [("freedom6", "beta")]
    assert "0.0042" in ROWS["freedom6", "beta"].note


def test_delta_and_omega_need_a_third_of_a_millisecond() -> None:
    for slug in ("delta", "omega"):
        row = ROWS[slug, "mu"]
        assert abs(row.difference) < 5e-4
        assert row.recomputed_as_printed / row.printed > 1.019
        assert "1/3 ms" in row.note


def test_a_difference_has_an_explanation() -> None:
    for device in TABLE_II:
        for row in compare(device):
            low, high = rounding(getattr(device, row.quantity))
            assert row.note or low <= row.recomputed_as_printed <= high, row


def test_every_device_is_locally_stable_as_the_paper_says() -> None:
    assert {region(d.loop.numbers) for d in TABLE_II} == {"D|E"}
    assert {region(d.loop.numbers, 0.01) for d in TABLE_II} == {"E"}


def test_human_operator_makes_every_device_but_none_alone_passive() -> None:
    for device in TABLE_II:
        share = grip_fraction(device.loop)
        assert 0.0 < share < 1.0
        held = device.loop.with_hand(damping=share * HUMAN_OPERATOR.damping * (1 + 1e-12))
        assert region(held.numbers) == "A"
    assert grip_fraction(TABLE_II[0].loop, Hand(0.0, 0.0, 600.0)) == float("inf")
    assert grip_fraction(TABLE_II[0].loop.with_hand(damping=4.8)) == 0.0


@pytest.mark.parametrize(
    ("printed", "low", "high"), [("0.33", 0.325, 0.335), ("14500", 14499.5, 14500.5), ("1", 0.5, 1.5)]
)
def test_rounding_is_half_a_unit_of_the_last_digit(printed: str, low: float, high: float) -> None:
    assert rounding(printed) == (pytest.approx(low), pytest.approx(high))


@pytest.mark.parametrize("device", TABLE_II, ids=lambda d: d.slug)
def test_presets_have_the_same_operating_point(device) -> None:  # type: ignore[no-untyped-def]
    ours, preset = device.loop.numbers, from_config(load_config(device.slug))
    assert preset.mu == pytest.approx(ours.mu, rel=1e-3)
    assert preset.beta == pytest.approx(ours.beta, rel=1e-3)
    assert preset.sigma == pytest.approx(ours.sigma, rel=1e-3)
