"""Recordings with hidden effects, made by physics that shares no code with the fitted model."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from hapticd.gap import find_gap
from hapticd.gap.candidates.angle import _is_series
from hapticd.gap.candidates.grip import _edge
from hapticd.gap.disagreement import balance_json
from hapticd.gap.screen import screen

if TYPE_CHECKING:
    from collections.abc import Callable

CATALOGUE = (
    "inertia_error", "viscous_friction", "coulomb_friction", "asymmetric_coulomb", "asymmetric_viscous", "constant_bias",
    "torque_constant_error", "return_spring", "gravity", "transport_delay", "encoder_eccentricity",
)  # fmt: skip
"""The cheap part of the catalogue."""

HIDDEN = [
    ({"name": "inertia_error", "r": 0.05}, "r", 0.05),
    ({"name": "coulomb_friction", "r": 0.08}, "r", 0.08),
    ({"name": "torque_constant_error", "r": -0.05}, "r", -0.05),
    ({"name": "transport_delay", "t_d": 1.3e-3}, "t_d", 1.3e-3),
    ({"name": "asymmetric_viscous", "a": 0.5}, "a", 0.5),
]


@pytest.mark.parametrize(("effect", "name", "value"), HIDDEN, ids=[h[0]["name"] for h in HIDDEN])
def test_a_hidden_effect_is_named(hidden: Callable[..., Any], effect: dict[str, Any], name: str, value: float) -> None:
    recording, model = hidden([effect])
    result = find_gap([recording], model, candidates=CATALOGUE)
    assert result.verdict == "effect_found"
    assert result.effects == (effect["name"],)
    found = result.steps[0].parameters[name]
    assert found.value == pytest.approx(value, rel=0.1)
    assert found.ci95[0] < found.value < found.ci95[1]
    assert result.gap.held_out_after < 1.2 < result.gap.held_out_before


@pytest.mark.parametrize("step", [0.02, 0.08])
def test_a_coarse_converter_is_named_whatever_its_step(hidden: Callable[..., Any], step: float) -> None:
    recording, model = hidden([{"name": "dac_quantization", "q": step}])
    result = find_gap([recording], model, candidates=["coulomb_friction", "transport_delay", "dac_quantization"])
    assert result.effects == ("dac_quantization",)
    found = result.steps[0].parameters["q"]
    assert found.value == pytest.approx(step, rel=1e-3)
    assert found.ci95[0] < found.value < found.ci95[1]
    assert result.gap.held_out_after < 1.2


@pytest.mark.parametrize(("f_r", "share"), [(28.0, 0.5), (61.0, 0.3)])
def test_a_lightly_damped_coupling_is_found_where_it_rings(
    hidden: Callable[..., Any], f_r: float, share: float
) -> None:
    effect = {"name": "flexible_coupling", "f_r": f_r, "load_share": share, "damping": 0.015}
    recording, model = hidden([effect])
    result = find_gap([recording], model, candidates=["inertia_error", "backlash", "flexible_coupling"])
    assert result.effects[0] == "flexible_coupling"
    found = result.steps[0].parameters
    assert found["f_r"].value == pytest.approx(f_r, rel=0.01)
    assert found["load_share"].value == pytest.approx(share, rel=0.05)
    assert found["damping"].value == pytest.approx(0.015, rel=0.3)


def test_play_with_a_rebound_is_not_taken_for_a_smaller_one(hidden: Callable[..., Any]) -> None:
    recording, model = hidden([{"name": "backlash", "gap": 0.055, "load_share": 0.3}])
    result = find_gap([recording], model, candidates=["coulomb_friction", "flexible_coupling", "backlash"])
    assert result.effects == ("backlash",)
    found = result.steps[0].parameters
    assert found["gap"].value == pytest.approx(0.055, rel=0.03)
    assert found["load_share"].value == pytest.approx(0.3, rel=0.1)


def test_a_strong_hand_is_found_where_it_holds(hidden: Callable[..., Any]) -> None:
    grip = {"name": "hand_impedance", "m_h": 1e-5, "b_h": 1e-4, "k_h": 2e-3, "rest": 0.0, "on_s": 3.3, "off_s": 1e9}
    recording, model = hidden([grip])
    result = find_gap([recording], model, candidates=["coulomb_friction", "return_spring", "hand_impedance"])
    assert result.effects == ("hand_impedance",)
    found = result.steps[0].parameters
    assert found["on_s"].value == pytest.approx(3.3, abs=0.15)
    assert found["on_s"].ci95[0] <= 3.3 <= found["on_s"].ci95[1]
    assert found["k_h"].value == pytest.approx(2e-3, rel=0.05)


def test_a_hand_that_never_lets_go_is_told_by_its_parts(hidden: Callable[..., Any]) -> None:
    recording, model = hidden(
        [{"name": "inertia_error", "r": 0.2}, {"name": "return_spring", "k_s": 2e-3, "theta_0": 0.3}]
    )
    result = find_gap([recording], model, candidates=["inertia_error", "return_spring", "hand_impedance"])
    assert set(result.effects) == {"inertia_error", "return_spring"}
    assert all("hand_impedance" not in step.indistinguishable_from for step in result.steps)


def test_an_edge_is_as_open_as_the_windows_around_it() -> None:
    """Nothing can be told of four windows in which the shaft rests; the others are clear."""
    gain = np.array([-9.0, -9.0, -9.0, 0.1, -0.1, 0.0, 0.1, 8.0, 8.0, 8.0])
    assert _edge(gain, 7) == (3, 7)
    assert _edge(gain, 4) == (3, 7)
    assert _edge(np.array([-9.0, -9.0, 9.0, 9.0]), 2) == (2, 2)


def test_a_series_in_the_position_is_no_ripple() -> None:
    assert _is_series(np.array([1, 2, 0, 3, 4]))
    assert not _is_series(np.array([6, 27, 13, 11]))
    assert not _is_series(np.array([1, 2, 3]))


def test_a_window_at_rest_finds_its_place_under_an_eccentric_encoder(hidden: Callable[..., Any]) -> None:
    """The velocity's derivative of a shaft about to slip is worthless; the position alone must do."""
    recording, model = hidden([{"name": "encoder_eccentricity", "e": 0.016, "phi": -1.26}])
    result = find_gap([recording], model, candidates=["encoder_eccentricity"])
    assert result.effects == ("encoder_eccentricity",)
    assert result.gap.held_out_after < 1.2
    assert result.steps[0].parameters["e"].value == pytest.approx(0.016, rel=0.02)


def test_a_torque_once_per_revolution_is_no_ripple(hidden: Callable[..., Any]) -> None:
    recording, model = hidden([{"name": "gravity", "m_g_l": 4e-3, "theta_0": 0.7}])
    result = find_gap([recording], model, candidates=["torque_ripple"])
    assert (result.verdict, result.effects) == ("unexplained", ())


def test_the_forces_are_told_where_no_prediction_is_good(hidden: Callable[..., Any]) -> None:
    ripple = {"name": "torque_ripple", "orders": [7, 28], "amplitudes": [4e-4, 8e-4], "phases": [0.0, 1.0]}
    recording, model = hidden([ripple])
    result = find_gap([recording], model, candidates=["coulomb_friction", "encoder_eccentricity"])
    assert result.verdict == "unexplained"
    assert "torque_ripple" not in [row["effect"] for row in result.balance["ranking"]]
    balance = balance_json(screen([recording], model), ["torque_ripple"], is_linear=False)
    assert balance["ranking"][0]["effect"] == "torque_ripple"
    assert "torque_ripple (orders 28, 7)" in balance["words"]
    assert balance["ranking"][0]["rms"] < 0.7 * balance["rms"]


def test_bias_and_asymmetric_coulomb_are_one_class(hidden: Callable[..., Any]) -> None:
    recording, model = hidden([{"name": "constant_bias", "tau_0": 1e-4}])
    result = find_gap([recording], model, candidates=CATALOGUE)
    assert result.verdict == "effect_found"
    step = result.steps[0]
    assert {step.effect, *step.indistinguishable_from} >= {"constant_bias", "asymmetric_coulomb"}


def test_what_explains_the_same_is_told_beside_the_name(hidden: Callable[..., Any]) -> None:
    recording, model = hidden([{"name": "gravity", "m_g_l": 1e-3, "theta_0": 0.7}])
    result = find_gap([recording], model, candidates=["gravity", "coulomb_friction"])
    assert result.effects == ("gravity",)
    pairs = {frozenset({pair["first"], pair["second"]}): pair for pair in result.to_json()["confounded"]}
    assert all("gravity" in pair for pair in pairs)
    ripple = pairs[frozenset({"gravity", "torque_ripple"})]
    assert ripple["overlap"] > 0.9
    assert not ripple["resolved"]


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_nothing_hidden_nothing_named(hidden: Callable[..., Any], seed: int) -> None:
    recording, model = hidden([], seed)
    result = find_gap([recording], model)
    assert result.verdict == "no_missing_effect"
    assert result.effects == ()
    assert result.gap.held_out_before == pytest.approx(1.0, abs=0.15)


def test_what_the_catalogue_lacks_is_not_given_a_wrong_name(hidden: Callable[..., Any]) -> None:
    recording, model = hidden([{"name": "encoder_eccentricity", "e": 0.05, "phi": 0.4}])
    others = tuple(slug for slug in CATALOGUE if slug != "encoder_eccentricity")
    result = find_gap([recording], model, candidates=others)
    assert result.verdict == "unexplained"


def test_progress_rises_to_one_and_a_document_comes_out(hidden: Callable[..., Any]) -> None:
    recording, model = hidden([], 14, 6.0)
    shares: list[float] = []
    result = find_gap([recording], model, candidates=CATALOGUE, progress=lambda share, text: shares.append(share))
    assert shares[-1] == 1.0
    assert result.to_json()["verdict"] == result.verdict


def test_what_limits_the_conclusions_goes_with_the_result(hidden: Callable[..., Any]) -> None:
    recording, model = hidden([], 14, 6.0)
    result = find_gap([replace(recording, warnings=("hidden: one way only",))], model, candidates=[])
    assert result.to_json()["warnings"] == ["hidden: one way only"]


def test_an_interrupt_comes_through(hidden: Callable[..., Any]) -> None:
    recording, model = hidden([], 14, 6.0)

    def interrupt(share: float, text: str) -> None:
        if share > 0.01:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        find_gap([recording], model, candidates=CATALOGUE, progress=interrupt)


def test_an_unknown_candidate_is_refused(hidden: Callable[..., Any]) -> None:
    recording, model = hidden([], 14, 6.0)
    with pytest.raises(ValueError, match="wobble"):
        find_gap([recording], model, candidates=["wobble"])


def test_a_strong_bias_is_not_taken_for_a_ripple(hidden: Callable[..., Any]) -> None:
    """Windows stuck in a wrong initial state must not decide: a law with more coordinates has more chances to free them."""
    recording, model = hidden([{"name": "asymmetric_coulomb", "a": 0.0675}], 2034, 12.0)
    names = ("asymmetric_coulomb", "constant_bias", "gravity", "torque_ripple")
    result = find_gap([recording], model, candidates=names)
    assert result.verdict == "effect_found"
    assert result.effects[0] in names[:2]
    assert result.gap.held_out_after < 1.2
