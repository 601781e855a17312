"""A recording that is never fitted: what holds there, what is refused, and which model the user is told to take."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hapticd.config import parse_config
from hapticd.figures.style import style
from hapticd.gap import find_gap
from hapticd.gap import text as gap_text
from hapticd.gap.base_model import known_terms, problem_of
from hapticd.gap.errors import RecordingError
from hapticd.gap.figures import measured_and_predicted
from hapticd.gap.fit import Fit
from hapticd.gap.nominal import nominal_fit
from hapticd.gap.prediction import Prediction, predicted, prediction_errors
from hapticd.gap.recording import Recording
from hapticd.gap.validation import Validation, check_validation, judged, validate

from .synthetic import model, run

GRAVITY = {"name": "gravity", "m_g_l": 1e-3, "theta_0": 0.0}


def weight(angle: float, velocity: float, time: float) -> float:
    return -1e-3 * float(np.sin(angle))


def test_the_improved_model_predicts_as_well_as_the_true_one() -> None:
    train, test = run(weight, 6.0, seed=1), replace(run(weight, 4.0, seed=2), name="test")
    result = find_gap([train], model(), candidates=["gravity"], design=False, validation=test)
    found = result.validation
    assert found is not None
    assert (found.run, found.verdict) == ("test", "better")
    assert found.evidence > 10.0
    true = parse_config({**model().model_dump(), "plant": {**model().plant.model_dump(), "effects": [GRAVITY]}}, "true")
    exact = predicted(nominal_fit(problem_of([test], true)))
    noise = prediction_errors(exact, exact, is_linear=False)
    for name in ("k_step", "free_run"):
        errors = found.errors[name]
        assert errors["after"] < 0.05 * errors["before"], name
        assert errors["after"] < 2.0 * noise[name]["after"], name
        assert errors["fit_percent"]["before"] < errors["fit_percent"]["after"] <= 100.0
    document = result.to_json()
    assert document["validation"]["free_run"]["unit"] == document["validation"]["unit"] == "rad"
    (line,) = gap_text.validated(document)
    assert line.startswith("validated on test, which was not fitted: 50 ms ahead: off by ")
    assert line.endswith(found.words)


def test_of_what_is_fitted_along_the_model_that_is_written_has_nothing(nominal_run: Recording) -> None:
    """A base within its uncertainty goes into no model.yaml, so it is not tested either."""
    rows = slice(0, 3000)
    arrays = {name: getattr(nominal_run, name)[rows] for name in ("time_s", "position", "current")}
    recording = replace(nominal_run, **arrays)
    config = model(uncertainty={"inertia": 2e-6})
    problem = problem_of([recording], config)
    plain = nominal_fit(problem)
    (inertia,) = known_terms(problem, config)
    along = Fit.started(problem, [inertia.moved([inertia.start[0] + 0.2])], plain.noise)
    errors = prediction_errors(predicted(along), predicted(plain), is_linear=False)["free_run"]
    assert errors["before"] > 2.0 * errors["after"]
    found = validate(along, plain, replace(recording, name="other"))
    assert found.verdict == "same"
    np.testing.assert_array_equal(found.before.free_run, found.after.free_run)


def _gappy(recording: Recording) -> Recording:
    rows = np.flatnonzero(np.arange(recording.rows) % 110 < 90)
    arrays = {name: getattr(recording, name)[rows] for name in ("time_s", "position", "current")}
    return replace(recording, name="gappy", **arrays)


@pytest.mark.parametrize(
    ("spoil", "statement"),
    [
        (
            lambda r: replace(r, name="copy"),
            "synthetic and copy are the same recording: name it once; a fitted recording is no test of the model",
        ),
        (_gappy, "gappy: no stretch without a gap is longer than 100 ms; nothing can be predicted"),
    ],
)
def test_what_tests_nothing_is_refused(
    nominal_run: Recording, spoil: Callable[[Recording], Recording], statement: str
) -> None:
    with pytest.raises(RecordingError, match=statement):
        find_gap([run(seconds=2.0, seed=3), nominal_run], model(), validation=spoil(nominal_run))


def test_another_motion_of_the_device_is_admitted(nominal_run: Recording) -> None:
    check_validation([nominal_run], run(seconds=2.0, seed=3))


def _errors(k_step: tuple[float, float], free_run: tuple[float, float]) -> dict[str, Any]:
    fit = {"fit_percent": {"before": 50.0, "after": 60.0}, "unit": "rad"}
    return {
        "horizon_s": 0.05,
        "unit": "rad",
        "k_step": {**dict(zip(("before", "after"), k_step, strict=True)), **fit},
        "free_run": {**dict(zip(("before", "after"), free_run, strict=True)), **fit},
    }


@pytest.mark.parametrize(
    ("k_step", "free_run", "verdict", "words"),
    [
        ((2.0, 1.0), (2.0, 1.0), "better", "(model.yaml) predicts it better"),
        ((2.0, 1.0), (2.0, 2.01), "better", "(model.yaml) predicts it better"),
        (
            (2.0, 1.0),
            (1.0, 2.0),
            "mixed",
            "it has the evidence (7.5 standard errors here, one step ahead)",
        ),
        ((2.0, 1.0), (1.0, np.inf), "mixed", "better 50 ms ahead, and worse over the whole record"),
        ((1.0, 2.0), (2.0, 1.0), "mixed", "A free run integrates any bias, so it may be better by chance"),
        ((1.0, 2.0), (1.0, 2.0), "worse", "fit both recordings together before you rely on it"),
        ((1.0, 1.01), (2.0, 2.0), "same", "Both models predict it equally well"),
    ],
)
def test_which_model_is_given_and_why(
    k_step: tuple[float, float], free_run: tuple[float, float], verdict: str, words: str
) -> None:
    found, said = judged(_errors(k_step, free_run), 7.5, is_improved=True)
    assert found == verdict
    assert words in said


def test_where_nothing_was_added_there_is_one_model() -> None:
    assert judged(_errors((1.0, 1.0), (1.0, 1.0)), 0.0, is_improved=False)[0] == "same"


def test_the_picture_keeps_to_what_was_measured() -> None:
    time_s = 1e-3 * np.arange(3000)
    begins = np.arange(3000) == 0
    measured = 2.0 * np.sin(3.0 * time_s)
    with np.errstate(over="ignore"):
        runaway = measured + np.expm1(400.0 * time_s)
    ahead = np.where(np.arange(3000) % 50 == 0, measured, np.nan)
    before = Prediction(time_s, begins, measured, ahead + 0.1, runaway)
    after = Prediction(time_s, begins, measured, ahead + 0.01, measured + 0.01)
    errors = prediction_errors(before, after, is_linear=False)
    assert errors["k_step"]["before"] == pytest.approx(0.1)
    assert errors["free_run"]["before"] == np.inf
    verdict, words = judged(errors, 20.0, is_improved=True)
    with style():
        figure = measured_and_predicted(Validation("drive.csv", verdict, errors, 400.0, 20.0, words, before, after))
        figure.draw_without_rendering()
    over, error, ahead_axis = figure.axes
    assert over.get_title(loc="left") == "drive.csv, which was not fitted"
    low, high = over.get_ylim()
    assert -6.5 < low < measured.min() < measured.max() < high < 6.5
    improved = over.lines[2]
    assert np.allclose(np.asarray(improved.get_ydata())[1:], np.asarray(over.lines[0].get_ydata())[1:] + 0.01)
    assert "error of the free run" in error.get_ylabel()
    assert "error 50 ms ahead" in ahead_axis.get_ylabel()
