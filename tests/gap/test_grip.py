"""A hand's grip: where it begins and ends, and how large it is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from benchmarks.gap.disturbance import Coloured
from hapticd.gap import find_gap, grip
from hapticd.gap.base_model import problem_of
from hapticd.gap.candidates import scale_of
from hapticd.gap.fit import Fit
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.score import Score
from hapticd.gap.terms import parameters_of_term

SECONDS = 12.0
HAND = {"m_h": 1.2e-5, "b_h": 8e-5, "k_h": 3e-3, "on_s": 4.6, "off_s": 8.3, "rest": 0.5}
"""As heavy and as stiff as the device: pushed by it, inertia and stiffness hide one another."""


@pytest.mark.parametrize("coloured", [None, Coloured(0.05, 0.2)])
def test_interval_and_sizes_are_found(hidden: Callable[..., Any], coloured: Coloured | None) -> None:
    recording, model = hidden([{"name": grip.SLUG, **HAND}], 3, SECONDS, coloured)
    present = nominal_fit(problem_of([recording], model))
    present.differentiate()
    scale = scale_of(present)
    (first,) = grip.first_grip(Score(present), scale)
    fit = grip.maximised(present.extended(first.term), 0, scale)
    found = parameters_of_term(fit.terms[0], fit.u[fit.columns(0)])
    names = [coordinate.name for coordinate in fit.terms[0].coordinates]
    for at, (earliest, latest) in grip.edge_ranges(fit, 0).items():
        name = names[at - fit.columns(0).start]
        assert earliest - 0.05 <= HAND[name] <= latest + 0.05
        assert latest - earliest < 0.6
        assert earliest <= found[name] <= latest
    for name in ("m_h", "b_h", "k_h", "rest"):
        assert found[name] == pytest.approx(HAND[name], rel=0.01 if coloured is None else 0.15), name


@pytest.mark.parametrize("coloured", [None, Coloured(0.05, 0.2)])
def test_an_edge_that_is_known_to_half_a_second_is_no_limit(
    hidden: Callable[..., Any], coloured: Coloured | None
) -> None:
    """The hand lets go of a shaft at rest, which shows when it moves again, and in one block alone."""
    recording, model = hidden([{"name": grip.SLUG, **HAND}], 1, SECONDS, coloured)
    found = find_gap([recording], model, candidates=[grip.SLUG, "inertia_error", "return_spring"], design=False)
    assert found.effects == (grip.SLUG,)
    earliest, latest = found.steps[0].parameters["off_s"].ci95
    assert earliest < HAND["off_s"] < latest < SECONDS
    assert latest - earliest > 0.3
    assert found.verdict == "effect_found", found.statement


def test_the_last_bit_does_not_decide_where_a_climb_ends(hidden: Callable[..., Any]) -> None:
    """Beside edges that were off by a fifth of a second it had ended up to 500 nats lower, as the processor rounds."""
    recording, model = hidden([{"name": grip.SLUG, **HAND}], 1, SECONDS)
    present = nominal_fit(problem_of([recording], model))
    present.differentiate()
    scale = scale_of(present)
    (first,) = grip.first_grip(Score(present), scale)
    start = grip.refined(present.extended(first.term), 0, scale)
    random = np.random.default_rng(1)
    ends = []
    for rounding in np.repeat((1e-7, 1e-6, 1e-5, 1e-4), 2):
        u = start.u + rounding * start.scale * random.standard_normal(start.u.size)
        fit = grip.maximised(Fit(start.problem, start.terms, u), 0, scale)
        for name, (earliest, latest) in zip(("on_s", "off_s"), grip.edge_ranges(fit, 0).values(), strict=True):
            assert earliest < HAND[name] < latest
        ends.append(fit.log_likelihood)
    assert np.ptp(ends) < 5.0


def test_there_is_no_grip_over_two_recordings(hidden: Callable[..., Any]) -> None:
    """The plant's time starts anew with each."""
    recording, model = hidden([], 3, 4.0)
    present = nominal_fit(problem_of([recording, recording], model))
    present.differentiate()
    assert grip.first_grip(Score(present), scale_of(present)) == []


def test_a_grip_on_nothing_promises_little(hidden: Callable[..., Any]) -> None:
    recording, model = hidden([], 3, SECONDS, Coloured(0.05, 0.05))
    present = nominal_fit(problem_of([recording], model))
    present.differentiate()
    (first,) = grip.first_grip(Score(present), scale_of(present))
    settled = grip.refined(present.extended(first.term), 0, scale_of(present))
    assert settled.log_likelihood - present.log_likelihood < 0.01 * present.out.size
    assert np.isfinite(settled.log_likelihood)


def test_a_climb_moves_an_edge_but_little(hidden: Callable[..., Any]) -> None:
    """A hand that would hold on for all of the record is inertia, friction and a spring; it had been reached."""
    recording, model = hidden([{"name": grip.SLUG, **HAND}], 3, SECONDS)
    present = nominal_fit(problem_of([recording], model))
    present.differentiate()
    (first,) = grip.first_grip(Score(present), scale_of(present))
    starts = {
        c.name: (value, c.lower, c.upper) for c, value in zip(first.term.coordinates, first.term.start, strict=True)
    }
    for name in ("on_s", "off_s"):
        start, lower, upper = starts[name]
        assert start - lower == pytest.approx(upper - start)
        assert upper - lower < 0.05 * SECONDS


def test_no_grip_is_shorter_than_what_can_be_held_out(hidden: Callable[..., Any]) -> None:
    """One of a tenth of a second had been named, for a jolt that the model did not know: no other block told of it."""
    recording, model = hidden([{"name": "backlash", "gap": 0.0066, "load_share": 0.38}], 3, SECONDS)
    present = nominal_fit(problem_of([recording], model))
    present.differentiate()
    (first,) = grip.first_grip(Score(present), scale_of(present))
    fit = grip.refined(present.extended(first.term), 0, scale_of(present)).maximise()
    found = parameters_of_term(fit.terms[0], fit.u[fit.columns(0)])
    assert found["off_s"] - found["on_s"] >= 2.0 * SECONDS / present.problem.series.blocks - 1e-9
