"""Along the filter's path: slopes of its predictions, and the smoothed force, against textbook, truth and differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from benchmarks.gap.disturbance import STEP_S, Coloured
from hapticd.gap.base_model import problem_of
from hapticd.gap.fit import Fit
from hapticd.gap.kernel.linear import sensitivities, smoothed
from hapticd.gap.kernel.ticks import SENSOR, WHITE
from hapticd.gap.missing import missing_force, moving
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.terms import Term, term

from .linear_case import Case, Floats, case, filtered, textbook
from .test_filter import NOISES


def white_power(one: Case) -> Floats:
    return np.asarray(float(one.noise[WHITE]) ** 2 / np.gradient(one.time_s))


@pytest.mark.parametrize("kind", NOISES)
def test_smoothed_is_the_rauch_tung_striebel_smoother(kind: str) -> None:
    one = case(NOISES[kind])
    _, out = filtered(one)
    exact = textbook(one)
    found = smoothed(out, white_power(one))
    for column, k in ((0, 1), (1, 2)):
        off = found[:, column] - exact.smoothed[:, k]
        assert np.abs(off / np.sqrt(exact.covariance[:, k, k])).max() < 0.02
    if kind != "white":
        assert found[:, 2] == pytest.approx(exact.covariance[:, 2, 2], rel=0.01)


def test_the_white_force_is_what_the_smoothed_velocity_lacks() -> None:
    one = case(NOISES["white"])
    _, out = filtered(one)
    found = smoothed(out, white_power(one))
    lacks = np.diff(textbook(one).smoothed[:, 1]) / np.diff(one.time_s) - one.current[:-1]
    assert found[:-1, 3] == pytest.approx(lacks, abs=0.02 * float(np.std(lacks)))
    assert found[-1, 3] == 0.0


def test_a_stretch_is_smoothed_on_its_own() -> None:
    one = case(NOISES["coloured"], n=300)
    begins = np.zeros(300, dtype=bool)
    begins[[0, 150]] = True
    found = smoothed(filtered(one, begins)[1], white_power(one))
    first = one._replace(time_s=one.time_s[:150], current=one.current[:150], measured=one.measured[:150])
    alone = smoothed(filtered(first)[1], white_power(first))
    assert found[:150] == pytest.approx(alone, rel=1e-6, abs=1e-9)


@pytest.fixture(scope="module")
def plain(hidden: Callable[..., Any]) -> Fit:
    recording, model = hidden([], 5, 6.0, Coloured(0.05, 0.05))
    return nominal_fit(problem_of([recording], model))


TORQUES: dict[str, tuple[Callable[[float], Term], Callable[[Any], Any]]] = {
    "constant_bias": (lambda size: term("constant_bias", {"tau_0": size}, (), 0.1), np.ones_like),
    "gravity": (
        lambda size: term("gravity", {"m_g_l": size, "theta_0": 0.4}, (), 0.1),
        lambda x: -np.sin(x - 0.4),
    ),
    "torque_ripple": (
        lambda size: term("torque_ripple", {"orders": [7.0], "amplitudes": [size], "phases": [0.3]}, ("orders",), 0.1),
        lambda x: np.sin(7.0 * x + 0.3),
    ),
}


@pytest.mark.parametrize("slug", TORQUES)
def test_sensitivities_are_the_filter_s_slopes(plain: Fit, slug: str) -> None:
    """While the shaft moves, cells below the noise: what gains and the modes' weights add is not in the linear path."""
    noise = plain.noise.copy()
    noise[SENSOR] = np.log(3.0 * plain.problem.series.resolution)
    fit = plain.with_noise(noise)
    item, torque = TORQUES[slug]
    size = 1e-4 * fit.problem.torque
    slope = (fit.extended(item(2.0 * size)).out["mean"] - fit.extended(item(size)).out["mean"]) / size
    answer = sensitivities(fit.out, torque(fit.out["x"])[:, None])[:, 0]
    moves = moving(fit)
    slope, answer = slope[moves], answer[moves]
    assert float(slope @ answer / (answer @ answer)) == pytest.approx(1.0, abs=0.15)
    # The filter takes most of a constant torque for its disturbance: kinks weigh more in the little that shows.
    assert np.corrcoef(slope, answer)[0, 1] > (0.7 if slug == "constant_bias" else 0.95)


def test_sensitivities_of_a_linear_filter_are_exact() -> None:
    one = case(NOISES["coloured"])
    ends = []
    for sign in (0.5, -0.5):
        _, out = filtered(one._replace(current=one.current + sign))
        ends.append(out["mean"])
    _, out = filtered(one)
    answer = sensitivities(out, np.ones((one.time_s.size, 1)))[:, 0]
    assert answer == pytest.approx(ends[0] - ends[1], rel=1e-2, abs=1e-3 * float(np.abs(answer).max()))


@pytest.mark.parametrize("tau_0", [2e-4, -6e-4])
def test_a_hidden_bias_is_read_off_the_missing_force(hidden: Callable[..., Any], tau_0: float) -> None:
    recording, model = hidden([{"name": "constant_bias", "tau_0": tau_0}], 3, 8.0)
    found = missing_force(nominal_fit(problem_of([recording], model)))
    assert found.rms == pytest.approx(abs(tau_0), rel=0.03)
    assert float(np.mean(found.force[found.moves])) == pytest.approx(tau_0, rel=0.03)


def test_the_smoothed_force_is_the_coloured_torque(hidden: Callable[..., Any], truth: Callable[..., Any]) -> None:
    asked: tuple[Any, ...] = ([], 4, 8.0, Coloured(0.25, 0.05))
    recording, model = hidden(*asked)
    fit = nominal_fit(problem_of([recording], model))
    found = missing_force(fit)
    device = truth(*asked).device
    at = recording.time_s + truth(*asked).time_s[0]
    true = np.interp(at, STEP_S * np.arange(device.coloured.size), device.coloured)
    moves = found.moves
    assert np.corrcoef(found.force[moves], true[moves])[0, 1] > 0.9
    # What it claims of its own error is about right.
    ratio = np.mean((found.force - true)[moves] ** 2) / np.mean(found.variance[moves])
    assert 0.5 < ratio < 3.0
