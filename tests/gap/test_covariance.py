"""Standard errors against refits: without a block, and on recordings that the model makes itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from benchmarks.gap.disturbance import Coloured
from hapticd.gap import constants
from hapticd.gap.base_model import problem_of
from hapticd.gap.covariance import covariance_of
from hapticd.gap.fit import Fit
from hapticd.gap.imitation import imitated
from hapticd.gap.kernel.ticks import NOISE
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.terms import term

if TYPE_CHECKING:
    from collections.abc import Callable

    Hidden = Callable[..., Any]

FIRST = len(NOISE)


def fitted(hidden: Hidden, slug: str, **values: float) -> Fit:
    """The true effect, fitted beside a torque of 50 ms."""
    recording, model = hidden([{"name": slug, **values}], 30, 6.0, Coloured(0.2, 0.05))
    return nominal_fit(problem_of([recording], model)).extended(term(slug, values, (), 0.1)).maximise()


def without_each_block(fit: Fit, step: float) -> np.ndarray[Any, Any]:
    """How far the first effect's coordinate moves without each block: the top of the parabola through three runs."""
    per_block, sums = fit.problem.series.per_block, []
    for away in (-step, 0.0, step):
        u = fit.u.copy()
        u[FIRST] += away
        sums.append(per_block(fit.evaluate(u)[1]["log_p"]))
    slope, bend = (sums[2] - sums[0]) / (2.0 * step), (2.0 * sums[1] - sums[0] - sums[2]) / step**2
    return (slope.sum() - slope) / (bend.sum() - bend) - slope.sum() / bend.sum()


@pytest.mark.parametrize(("slug", "value"), [("constant_bias", {"tau_0": 3e-4}), ("quadratic_drag", {"d": 1e-7})])
def test_leaving_out_blocks_in_turn_says_how_uncertain_a_parameter_is(
    hidden: Hidden, slug: str, value: dict[str, float]
) -> None:
    """The sums of scores around which a sandwich is made had given a fourth of it for the drag, which few blocks know."""
    fit = fitted(hidden, slug, **value)
    deviation = float(np.sqrt(covariance_of(fit)[FIRST, FIRST]))
    moved = without_each_block(fit, 0.3 * deviation)
    expected = np.sqrt((1.0 - 1.0 / moved.size) * np.sum(moved**2))
    assert deviation == pytest.approx(expected, rel=0.15)


def test_no_standard_error_is_less_than_what_the_model_s_own_recordings_show(hidden: Hidden) -> None:
    """Each of them fitted to the end; blocks of the real one left out in turn say two thirds of that."""
    fit = fitted(hidden, "gravity", m_g_l=1e-3, theta_0=0.3)
    refits = [fit.on(imitated(fit, seed)).maximise() for seed in range(constants.IMITATIONS)]
    spread = np.sqrt(np.mean([(refit.u[FIRST] - fit.u[FIRST]) ** 2 for refit in refits]))
    assert float(np.sqrt(covariance_of(fit)[FIRST, FIRST])) > 0.85 * spread
