"""Validation on another recording of the same device, which is not fitted.

The given and the improved model both predict it. A fitted late or filtered record is kept, because it belongs to the logger.
Lines are not, because their phases belong to the fitted recordings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import late_record
from hapticd.gap.checks import check_together
from hapticd.gap.errors import RecordingError
from hapticd.gap.fit import Fit
from hapticd.gap.law_set import LawSet, evidence
from hapticd.gap.prediction import HORIZON_S, predicted, prediction_errors, stretches
from hapticd.gap.series import series_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from hapticd.gap.prediction import Prediction
    from hapticd.gap.recording import Recording
    from hapticd.gap.series import Series

Verdict = Literal["better", "worse", "mixed", "same"]
_SAME = 0.05
"""Relative difference below which two errors count as equal."""


@dataclass(frozen=True)
class Validation:
    """How both models predict a recording that was not fitted.

    Attributes:
        run: file of the recording. verdict: the improved model compared with the given one.
        errors: see `prediction_errors`.
        log_likelihood_gain: of the improved model over the given one, one step ahead, nats.
        evidence: the same in standard errors.
        words: which model is in model.yaml, and why.
        before, after: predictions of the given and of the improved model, for the figure; not part of `gap.json`.
    """

    run: str
    verdict: Verdict
    errors: Mapping[str, Any]
    log_likelihood_gain: float
    evidence: float
    words: str
    before: Prediction
    after: Prediction

    def to_json(self) -> dict[str, Any]:
        """Its part of `gap.json`, with plain types."""
        return {
            "run": self.run,
            "verdict": self.verdict,
            **self.errors,
            "log_likelihood_gain": self.log_likelihood_gain,
            "evidence": self.evidence,
            "words": self.words,
        }


def check_validation(recordings: Sequence[Recording], validation: Recording) -> None:
    """Refuse a recording that is no test.

    Raises:
        RecordingError: it is one of the fitted recordings, or too short for a prediction.
    """
    for recording in recordings:
        try:
            check_together([recording, validation])
        except RecordingError as error:
            raise RecordingError(f"{error}; a fitted recording is no test of the model") from None
    if not any(stretches(series_of([validation]))):
        raise RecordingError(
            f"{validation.name}: no stretch without a gap is longer than {2e3 * HORIZON_S:g} ms; nothing can be predicted"
        )


def validate(before: Fit, after: Fit, validation: Recording) -> Validation:
    """Predict a recording that passed `check_validation`.

    Args:
        before: fit of the given model. after: of the improved one. validation: the recording, which is not fitted.
    """
    series = series_of([validation])
    fits = [_carried(fit, series) for fit in (before, after)]
    of_before, of_after = (predicted(fit) for fit in fits)
    assert of_before is not None
    assert of_after is not None
    errors = prediction_errors(of_before, of_after, validation.is_linear)
    given, improved = (LawSet(fit, series.per_block(fit.out["log_p"])) for fit in fits)
    gain, standard_errors = evidence(improved, given)
    added = [slug for slug in improved.laws if slug not in given.laws]
    verdict, words = judged(errors, standard_errors, bool(added))
    return Validation(validation.name, verdict, errors, gain, standard_errors, words, of_before, of_after)


def _carried(fit: Fit, series: Series) -> Fit:
    """A fit's model on other samples."""
    kept = [k for k, item in enumerate(fit.terms) if item.slug in CATALOGUE or item.slug == late_record.SLUG]
    u = np.concatenate([fit.noise, *(fit.u[fit.columns(k)] for k in kept)])
    return Fit(replace(fit.problem, series=series), [fit.terms[k] for k in kept], u)


def judged(errors: Mapping[str, Any], standard_errors: float, is_improved: bool) -> tuple[Verdict, str]:
    """Compare the improved model with the given one; also a text that says which one is in model.yaml, and why.

    Args:
        errors: of `prediction_errors`. standard_errors: evidence of the improved model, one step ahead.
        is_improved: whether the two models differ.
    """
    if not is_improved:
        return "same", "Nothing was added to the model, so there is one model to test."
    ahead = f"{1e3 * errors['horizon_s']:.3g} ms ahead"
    near, far = (_change(errors[name]) for name in ("k_step", "free_run"))
    if near == far == 0:
        return "same", (
            "Both models predict it equally well: they differ little for this motion. model.yaml is the improved model, "
            "because of its evidence in the fitted recordings."
        )
    if min(near, far) >= 0:
        return "better", "The improved model (model.yaml) predicts it better: the found effects are confirmed."
    if max(near, far) <= 0:
        return "worse", (
            "The improved model predicts it worse: the found effects may be specific to the fitted recordings (another "
            "load, temperature or zero of the position), or due to chance. model.yaml is the improved model, because of "
            "its evidence there; fit both recordings together before you rely on it."
        )
    if near > 0:
        return "mixed", (
            f"The improved model predicts it better {ahead}, and worse over the whole record. model.yaml is the "
            f"improved model: it has the evidence ({standard_errors:.1f} standard errors here, one step ahead), and a "
            "free run integrates even a small bias."
        )
    return "mixed", (
        f"The improved model predicts it worse {ahead}, and better over the whole record. model.yaml is the improved "
        f"model, because of its evidence in the fitted recordings ({standard_errors:.1f} standard errors here). A free run "
        "integrates any bias, so it may be better by chance. Fit both recordings together before you rely on it."
    )


def _change(error: Mapping[str, Any]) -> int:
    """1 if the improved model is better, −1 if it is worse, 0 if the difference is negligible."""
    before, after = error["before"], error["after"]
    return int(after < (1.0 - _SAME) * before) - int(after > (1.0 + _SAME) * before)
