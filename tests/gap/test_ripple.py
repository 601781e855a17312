"""Orders of a ripple, looked for again beside what the first ones explain."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hapticd.gap import ripple
from hapticd.gap.base_model import problem_of
from hapticd.gap.candidates import scale_of
from hapticd.gap.kernel.linear import sensitivities
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.score import Score
from hapticd.gap.terms import term

HIDDEN = {"name": "torque_ripple", "orders": [7, 28], "amplitudes": [6e-4, 3e-4], "phases": [0.4, -1.0]}


def _of_orders(orders: list[int]) -> dict[str, Any]:
    size = len(orders)
    return {"name": "torque_ripple", "orders": orders, "amplitudes": [1e-3] * size, "phases": [0.4, -1.0][:size]}


@pytest.mark.parametrize(("begun", "more"), [([7, 50], 0), ([7], 1), ([7, 28], 0)])
def test_orders_are_looked_for_again(hidden: Callable[..., Any], begun: list[int], more: int) -> None:
    recording, model = hidden([HIDDEN], 3, 8.0)
    present = nominal_fit(problem_of([recording], model))
    values = {"orders": begun, "amplitudes": [3e-4] * len(begun), "phases": [0.0] * len(begun)}
    fit = present.extended(term(ripple.SLUG, values, ("orders",), 0.1)).maximise()
    found, dearer = ripple.refined(fit, 0, scale_of(fit))
    orders = {order for _, order in found.terms[0].fixed}
    assert {7.0, 28.0} <= orders <= {7.0, 28.0, *begun}
    assert found.log_likelihood - dearer >= fit.log_likelihood
    # Each order costs the logarithm of how many there are to choose from.
    assert dearer == pytest.approx((len(orders) - len(begun)) * math.log(89.0), rel=0.2)
    assert len(orders) - len(begun) <= more


@pytest.mark.parametrize("hidden_orders", [[2], [7, 8]])
def test_orders_over_little_travel(hidden: Callable[..., Any], hidden_orders: list[int]) -> None:
    """Order 2 makes one wavelength and a quarter over this travel, and 7 and 8 drift apart by 0.6."""
    recording, model = hidden([_of_orders(hidden_orders)], 2, 8.0)
    present = nominal_fit(problem_of([recording], model))
    present.differentiate()
    scale = scale_of(present)
    assert 0.6 < scale.travel / (2.0 * math.pi) < 0.7
    [candidate] = ripple.first_orders(Score(present), scale)
    assert sorted(order for _, order in candidate.term.fixed) == hidden_orders


@pytest.mark.parametrize(
    "companion",
    [
        {"name": "gravity", "m_g_l": 1e-3, "theta_0": 0.5},
        {"name": "return_spring", "k_s": 1e-3, "theta_0": 0.3},
        {"name": "constant_bias", "tau_0": 6e-4},
    ],
    ids=lambda effect: effect["name"],
)
def test_orders_do_not_make_up_for_a_smooth_torque(hidden: Callable[..., Any], companion: dict[str, Any]) -> None:
    recording, model = hidden([{**HIDDEN, "orders": [3, 28]}, companion], 2, 8.0)
    present = nominal_fit(problem_of([recording], model))
    present.differentiate()
    [candidate] = ripple.first_orders(Score(present), scale_of(present))
    assert sorted(order for _, order in candidate.term.fixed) == [3.0, 28.0]


@pytest.mark.parametrize(("hidden_orders", "found"), [([2, 28], [2.0, 28.0]), ([2], None)])
def test_an_order_that_does_not_go_round(hidden: Callable[..., Any], hidden_orders: list[int], found: Any) -> None:
    """Over less than a wavelength it is an order beside one that goes round; by itself any smooth torque is as good."""
    recording, model = hidden([_of_orders(hidden_orders)], 2, 8.0)
    swept = np.maximum.accumulate(recording.position) - np.minimum.accumulate(recording.position)
    some = {name: getattr(recording, name)[swept < 3.0] for name in ("time_s", "position", "current")}
    present = nominal_fit(problem_of([replace(recording, **some)], model))
    present.differentiate()
    scale = scale_of(present)
    assert recording.rows / 4 < present.out.size
    assert 2.0 * scale.travel < 0.99 * 2.0 * math.pi
    candidates = ripple.first_orders(Score(present), scale)
    orders = [sorted(order for _, order in candidate.term.fixed) for candidate in candidates]
    assert orders == ([found] if found else [])


def test_orders_that_the_model_has_promise_nothing(hidden: Callable[..., Any]) -> None:
    """Of their information rounding alone is left; where that was zero or less no pair could be solved for."""
    recording, model = hidden([HIDDEN], 3, 8.0)
    values = {"orders": HIDDEN["orders"], "amplitudes": HIDDEN["amplitudes"], "phases": HIDDEN["phases"]}
    fit = nominal_fit(problem_of([recording], model), (term(ripple.SLUG, values, ("orders",), 0.1),))
    fit.differentiate()
    turned = np.multiply.outer(fit.out["x"], np.arange(1.0, 60.0))
    columns = np.stack([np.sin(turned), np.cos(turned)], axis=2).reshape(len(turned), -1)
    g, H = Score(fit).reduced([sensitivities(fit.out, columns)])
    own = [2 * (order - 1) + part for order in HIDDEN["orders"] for part in (0, 1)]
    assert np.linalg.eigvalsh(H[np.ix_(own, own)]).min() > 0.0
    assert g[own] @ np.linalg.solve(H[np.ix_(own, own)], g[own]) < 1e-6
