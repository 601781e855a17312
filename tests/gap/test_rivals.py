"""From fitted hypotheses to devices that an experiment to come can be tried on."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np

from hapticd.config import parse_config
from hapticd.gap.candidates.build import Scalar, scalar_term
from hapticd.gap.hypothesis import Hypothesis, Term
from hapticd.gap.rivals import Rival, pairs, rival
from hapticd.gap.search import Judged
from hapticd.plant.layout import device_vector

MODEL = parse_config({"plant": {"effects": [{"name": "stribeck", "s": 0.1, "omega_s": 2.0}]}}, "model")
DRAG = scalar_term("quadratic_drag", Scalar("d", 1e-7, -1e-6, 1e-6))
DELAY = scalar_term("transport_delay", Scalar("t_d", 2e-3, 0.0, 0.1))
LAG = scalar_term("amplifier_lag", Scalar("f_a", 90.0, 10.0, 500.0, True), Scalar("delta", 0.7, 0.3, 2.0))
VISCOUS = scalar_term("viscous_friction", Scalar("r", 0.5, -1.0, 20.0))
GRIP = scalar_term("hand_impedance", Scalar("m_h", 1e-6, 0.0, 1e-4), Scalar("b_h", 1e-5, 0.0, 1e-3))


def judged(*terms: Term) -> Judged:
    hypothesis = Hypothesis(device_vector(MODEL), terms)
    fit = SimpleNamespace(solution=SimpleNamespace(u=hypothesis.start()))
    return cast(Judged, SimpleNamespace(hypothesis=hypothesis, fit=fit))


def effects(found: Rival | None) -> dict[str, dict[str, object]]:
    assert found is not None
    return {effect.name: effect.model_extra or {} for effect in found.config.plant.effects}


def test_a_rival_is_the_model_with_its_own_effect_and_those_found_later() -> None:
    final = judged(DRAG, DELAY, VISCOUS)
    found = rival(MODEL, judged(DRAG, LAG), final, LAG.slug)
    assert found is not None
    assert found.slug == "amplifier_lag"
    assert found.hypothesis.slugs == ("quadratic_drag", "amplifier_lag", "viscous_friction")
    np.testing.assert_allclose(found.u, [1e-7, np.log(90.0), 0.7, 0.5])
    assert list(effects(found)) == ["stribeck", "quadratic_drag", "amplifier_lag"]
    assert effects(found)["amplifier_lag"]["f_a"] == 90.0
    assert found.config.plant.viscous == 1.5 * MODEL.plant.viscous


def test_nobody_holds_the_handle_in_an_experiment_to_come() -> None:
    found = rival(MODEL, judged(DRAG, GRIP), judged(DRAG, GRIP, DELAY), GRIP.slug)
    assert found is not None
    assert (found.slug, found.hypothesis.slugs) == ("hand_impedance", ("quadratic_drag", "transport_delay"))
    np.testing.assert_allclose(found.u, [1e-7, 2e-3])
    assert "hand_impedance" not in effects(found)


def test_lost_commands_cannot_be_known_beforehand() -> None:
    lost = Term("dropped_samples", (), lambda vector, u: None, lambda u: {"p": 0.1}, (), lost=(np.ones(3, np.uint8),))
    assert rival(MODEL, judged(lost), judged(lost), lost.slug) is None


def test_every_rival_is_tried_against_the_first_both_ways() -> None:
    a, b, c = (cast(Rival, name) for name in "abc")
    assert pairs([a, b, c]) == [("a", "b"), ("b", "a"), ("a", "c"), ("c", "a")]
