"""A recording of the same device that is never fitted: does what was found in others hold there too?

Both models predict it as they are written: the model as given, and the one with the laws that were found. Of what was fitted
along and is no law, a late or filtered record is kept, which belongs to the logger; lines are not, whose phases are those of
the recordings that were fitted.
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
"""Relative difference of two errors up to which they are the same."""


@dataclass(frozen=True)
class Validation:
    """How both models predict a recording that was not fitted.

    Attributes:
        run: file that the recording came from. verdict: the improved model against the one as given.
        errors: see `prediction_errors`.
        log_likelihood_gain: of the improved model over the one as given, from each sample to the next, nats.
        evidence: the same in standard errors.
        words: which model is in model.yaml, and why.
        before, after: predictions by the model as given and by the improved one, for the figure; not part of `gap.json`.
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
        """What `gap.json` has of it, of plain types."""
        return {
            "run": self.run,
            "verdict": self.verdict,
            **self.errors,
            "log_likelihood_gain": self.log_likelihood_gain,
            "evidence": self.evidence,
            "words": self.words,
        }


def check_validation(recordings: Sequence[Recording], validation: Recording) -> None:
    """Refuse a recording that tests nothing.

    Raises:
        RecordingError: it is one of those that are fitted, or has no stretch in which something can be predicted.
    """
    for recording in recordings:
        try:
            check_together([recording, validation])
        except RecordingError as error:
            raise RecordingError(f"{error}; what is fitted is no test of the model") from None
    if not any(stretches(series_of([validation]))):
        raise RecordingError(
            f"{validation.name}: no stretch without a gap is longer than {2e3 * HORIZON_S:g} ms; nothing can be predicted"
        )


def validate(before: Fit, after: Fit, validation: Recording) -> Validation:
    """Predict a recording that passed `check_validation`.

    Args:
        before: fit of the model as given. after: of the improved one. validation: is not fitted.
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
    """The improved model against the one as given, and which of them is in model.yaml, and why.

    Args:
        errors: of `prediction_errors`. standard_errors: of evidence, from each sample to the next.
        is_improved: whether the two models differ.
    """
    if not is_improved:
        return "same", "Nothing was added to the model, so there is one model to test."
    ahead = f"{1e3 * errors['horizon_s']:.3g} ms ahead"
    near, far = (_change(errors[name]) for name in ("k_step", "free_run"))
    if near == far == 0:
        return "same", (
            "Both models predict it equally well: they differ little in such a motion. model.yaml is the improved model, "
            "for its evidence in the recordings that were fitted."
        )
    if min(near, far) >= 0:
        return "better", "The improved model (model.yaml) predicts it better: what was found holds there too."
    if max(near, far) <= 0:
        return "worse", (
            "The improved model predicts it worse: what was found may belong to the recordings that were fitted (another "
            "load, temperature or zero of the position), or to chance. model.yaml is the improved model, for its "
            "evidence there; fit both recordings together before you rely on it."
        )
    if near > 0:
        return "mixed", (
            f"The improved model predicts it better {ahead}, and worse over the whole record. model.yaml is the "
            f"improved model: it has the evidence ({standard_errors:.1f} standard errors here, from each sample to the "
            "next), and a free run integrates any bias, however small."
        )
    return "mixed", (
        f"The improved model predicts it worse {ahead}, and better over the whole record. model.yaml is the improved "
        f"model, for its evidence in the recordings that were fitted ({standard_errors:.1f} standard errors here); a free "
        "run integrates any bias, so that it may be better by chance. Fit both recordings together before you rely on it."
    )


def _change(error: Mapping[str, Any]) -> int:
    """1 where the improved model is better, −1 where it is worse, 0 where there is no difference that matters."""
    before, after = error["before"], error["after"]
    return int(after < (1.0 - _SAME) * before) - int(after > (1.0 + _SAME) * before)
