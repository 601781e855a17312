"""What ``hapticd gap`` says of results of every kind; what it finds is another matter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from syrupy.assertion import SnapshotAssertion

from hapticd.gap import outputs
from hapticd.gap.prediction import Prediction
from hapticd.gap.result import Estimate, GapNumbers, GapResult, Ranked, Remainder, Step
from hapticd.gap.validation import Validation, judged
from tests.cli.conftest import Run

STRIBECK = Step(
    "stribeck",
    {"s": Estimate(0.412, (0.38, 0.44), ""), "omega_s": Estimate(1.5, (1.2, 1.9), "rad/s")},
    gap_before=2.31e-4,
    gap_after=1.04e-5,
    share=0.97,
    evidence=9.8,
    log_likelihood_gain=400.0,
    indistinguishable_from=(),
    ranking=(Ranked("stribeck", 400.0, 9.8, 0.0), Ranked("presliding", 80.0, 5.0, 7.25)),
    entry={"s": 0.412, "omega_s": 1.5},
)
RIPPLE = replace(
    STRIBECK,
    effect="torque_ripple",
    parameters={"amplitudes[0]": Estimate(1e-3, (9e-4, 1.1e-3), "N m")},
    ranking=(Ranked("torque_ripple", 90.0, 8.0, 0.0),),
    entry={"orders": [7.0, 14.0], "amplitudes": [1e-3, 2e-4], "phases": [0.1, 0.2]},
)
BIAS = replace(
    STRIBECK,
    effect="constant_bias",
    parameters={"tau_0": Estimate(5e-4, (4.8e-4, 5.2e-4), "N m")},
    indistinguishable_from=("asymmetric_coulomb",),
    ranking=(Ranked("return_spring", 43.0, 8.7, 0.0), Ranked("constant_bias", 42.0, 8.5, 0.0)),
    entry={"tau_0": 5e-4},
)
WHERE = (
    {"coordinate": "speed, against the motion", "range": [0.02, 2.0], "share": 0.62},
    {"coordinate": "everywhere", "range": [1.2e-4, 1.2e-4], "share": 0.2},
    {"coordinate": "position", "range": [0.0, 1.0], "share": 0.001},
)
LEFT = Remainder(
    0.3,
    "30 % of the missing force's power is left: a torque that depends on the position.",
    ({"coordinate": "position", "share": 0.3, "p_value": 1e-6},),
)
ERRORS = {"k_step": {"before": 0.05, "after": 0.0003}, "free_run": {"before": 1.7, "after": 1.7}}
FOUND = GapResult(
    "effect_found",
    "Missing: stribeck (missing 0.000231 N m before, 1.04e-05 N m after).",
    ("stribeck",),
    (STRIBECK,),
    GapNumbers(2.3e-4, 1.02e-5, 2.31e-4, 1.04e-5, 1e-6, "N m"),
    Remainder(0.002, "0.2 % of the missing force's power is left.", ()),
    where=WHERE,
    base={"inertia": Estimate(7e-6, (6.9e-6, 7.1e-6), "kg m²")},
    prediction={"horizon_s": 0.05, "unit": "rad", **ERRORS},
    recording={"missed": 0, "jitter_s": 2e-6, "period_s": 1e-3, "warnings": []},
    details={"samples": 4000, "blocks": 20, "candidates": ["stribeck"], "needed_standard_errors": 4.2},
)
_NONE = np.zeros(0)
_ERRORS = {
    "horizon_s": 0.05,
    "unit": "rad",
    "k_step": {"before": 0.05, "after": 0.0003, "unit": "rad", "fit_percent": {"before": 91.7, "after": 99.95}},
    "free_run": {"before": 1.7, "after": 2.1, "unit": "rad", "fit_percent": {"before": 12.3, "after": -8.4}},
}
_PREDICTION = Prediction(_NONE, np.zeros(0, dtype=bool), _NONE, _NONE, _NONE)
TESTED = Validation(
    "chirp.arrow",
    judged(_ERRORS, 7.5, is_improved=True)[0],
    _ERRORS,
    310.0,
    7.5,
    judged(_ERRORS, 7.5, is_improved=True)[1],
    _PREDICTION,
    _PREDICTION,
)
PLAN = {
    "words": "Play a chirp: expected separation of stribeck and presliding: 9.0 standard errors.",
    "separates": ["stribeck", "presliding"],
    "expected": 9.0,
    "now": 0.4,
    "experiment": {"excitation": "chirp", "amplitude": 0.3, "duration_s": 4.0, "settings": {"encoder.decimation": 1}},
    "file": "next_experiment.yaml",
}
LATE = {"missed": 40, "jitter_s": 1e-4, "current_late_s": {"value": 2e-3, "ci95": [1.9e-3, 2.1e-3]}}
RESULTS = {
    "found": FOUND,
    "two": replace(
        FOUND,
        statement="Missing: stribeck and torque_ripple.",
        effects=("stribeck", "torque_ripple"),
        steps=(STRIBECK, RIPPLE),
        base={},
    ),
    "same law": replace(FOUND, statement="Missing: constant_bias.", effects=("constant_bias",), steps=(BIAS,)),
    "ambiguous": replace(
        FOUND,
        verdict="ambiguous",
        statement="These data do not distinguish which it is: stribeck or presliding.",
        steps=(replace(STRIBECK, indistinguishable_from=("presliding",)),),
        next_experiment=PLAN,
    ),
    "partly explained": replace(FOUND, verdict="partly_explained", remainder=LEFT),
    "validated": replace(FOUND, validation=TESTED),
    "interrupted": replace(FOUND, statement=f"Interrupted: {FOUND.statement}", interrupted=True),
    "bad timing": replace(FOUND, recording={**FOUND.recording, **LATE, "warnings": ["the motion goes one way"]}),
    "unexplained": replace(
        FOUND,
        verdict="unexplained",
        statement=f"Something is missing that no effect of the catalogue explains (0.000231 N m): {LEFT.words}",
        effects=(),
        steps=(),
        base={},
        remainder=LEFT,
        prediction={},
    ),
    "nothing": replace(
        FOUND,
        verdict="no_missing_effect",
        statement="No effect is missing.",
        effects=(),
        steps=(),
        where=(),
        base={},
    ),
}


@pytest.mark.parametrize("case", RESULTS)
def test_gap(
    hapticd: Run, snapshot: SnapshotAssertion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    """The text, the document, and the effects of the improved model; the report has tests of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("hapticd.gap.find_gap", lambda recordings, model, **options: RESULTS[case])
    monkeypatch.setattr(outputs, "page", lambda *words: "")
    assert hapticd("simulate", "--duration", "1.5", "--deflection", "700", "-o", "run.arrow").code == 0
    text = hapticd("gap", "run.arrow", "-o", "gap")
    model = Path("gap/model.yaml").read_text().splitlines()
    found: dict[str, Any] = {
        "code": text.code,
        "text": text.out.splitlines(),
        "stderr": text.err.splitlines(),
        "files": sorted(path.name for path in Path("gap").iterdir()),
        "model": [line for line in model if "# gap" in line or line.startswith(("# ", "    - "))],
        "document": hapticd("gap", "run.arrow", "-o", "gap", "--force", "--json").document,
    }
    assert found == snapshot
