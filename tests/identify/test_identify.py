"""A device is found from its recordings, whatever the config says of its plant, with intervals that hold the truth."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.api.simulation import simulate
from hapticd.config import load_config, parse_config
from hapticd.gap.balance import balance
from hapticd.gap.errors import RecordingError
from hapticd.identify import Identified, identified_model, identify, readable
from hapticd.identify.result import UNCERTAIN
from hapticd.stability.numbers import from_config

from ..gap.synthetic import COULOMB, INERTIA, TORQUE_CONSTANT, VISCOUS, model
from .synthetic import BIAS, recorded, wrong_model


@pytest.fixture(scope="module")
def found() -> Identified:
    """Identified from a run whose encoder counts against the torque, with a plant wrong by sixty."""
    return identify([recorded(sign=-1)], wrong_model(), known_inertia=2.0 * INERTIA)


@pytest.mark.parametrize(
    ("name", "true"), [("inertia", INERTIA), ("viscous", VISCOUS), ("coulomb", COULOMB), ("bias", BIAS)]
)
def test_parameters_are_recovered(found: Identified, name: str, true: float) -> None:
    """To 3 %: the synthetic friction is a smooth sign, which is no Coulomb friction near rest."""
    estimate = getattr(found, name)
    assert estimate.value == pytest.approx(true, rel=0.03 if name != "viscous" else 0.2)
    assert estimate.ci95[0] < estimate.value < estimate.ci95[1]
    assert estimate.unit


def test_the_wrong_sign_is_found_and_put_right(found: Identified) -> None:
    assert found.sign == -1
    assert identified_model(wrong_model(), found).encoder.invert
    assert found.document["encoder"] == {"sign": -1, "invert_changes": True}


def test_the_right_sign_stays() -> None:
    for sign in (1, -1):
        assert balance([recorded(sign=sign)], TORQUE_CONSTANT).sign == sign


def test_a_known_inertia_tells_the_torque_constant(found: Identified) -> None:
    """The motion knows the ratio alone: twice the inertia is twice the torque constant."""
    implied = found.torque_constant_implied
    assert implied is not None
    assert implied.value == pytest.approx(2.0 * TORQUE_CONSTANT, rel=0.03)
    assert implied.ci95[0] < implied.value < implied.ci95[1]


def test_the_operating_point_does_not_depend_on_the_torque_constant(found: Identified) -> None:
    """The same run, read with twice the torque constant: inertia and friction double, and so does the rendered spring."""
    data = wrong_model().model_dump()
    data["amplifier"]["torque_constant"] *= 2.0
    double = identify([recorded(sign=-1)], parse_config(data, "double"))
    assert double.inertia.value == pytest.approx(2.0 * found.inertia.value, rel=1e-3)
    assert double.coulomb.value == pytest.approx(2.0 * found.coulomb.value, rel=1e-3)


def test_the_model_carries_values_and_uncertainty(found: Identified) -> None:
    config = identified_model(wrong_model(), found)
    assert config.plant.inertia == found.inertia.value
    assert {effect.name for effect in config.plant.effects} == {"constant_bias"}
    assert config.plant.uncertainty.inertia == pytest.approx(float(found.deviations[0]))
    matrix = np.array(config.plant.uncertainty.matrix)
    np.testing.assert_allclose(matrix, found.correlation, atol=1e-4)
    assert np.linalg.eigvalsh(matrix)[0] > -1e-3
    assert from_config(config).mu > 0.0


def test_deviations_make_the_same_interval(found: Identified) -> None:
    low, high = found.coulomb.ci95
    assert 2 * 1.959964 * found.deviations[UNCERTAIN.index("coulomb")] == pytest.approx(high - low, rel=1e-6)


def test_what_was_assumed_is_said(found: Identified) -> None:
    assert any("torque_constant = 0.03" in text for text in found.assumed)
    assert any("8192 counts/rev" in text for text in found.assumed)


def test_a_second_run_narrows_the_intervals(found: Identified) -> None:
    both = identify([recorded(1), recorded(2)], model())
    assert both.coulomb.value == pytest.approx(COULOMB, rel=0.03)
    assert both.runs == ("run1", "run2")
    assert both.sign == 1


def test_a_single_swing_is_said_to_tell_too_little(found: Identified) -> None:
    """All there is after a release is over within a fraction of a second; its delay and viscous friction hardly part."""
    config = {"spring": {"stiffness": 0.004}, "plant": {"inertia": 9e-6, "coulomb": 3e-4}}
    swing = identify([readable(simulate(config, 3.0, deflection=900), load_config(None))], load_config(None))
    said = [text for text in swing.warnings if "too little for reliable intervals" in text]
    assert len(said) == 1
    assert not any("too little for reliable intervals" in text for text in found.warnings)


def test_no_recording_and_no_motion_are_refused() -> None:
    from dataclasses import replace

    with pytest.raises(ValueError, match="no recording"):
        identify([], model())
    still = replace(recorded(), position=np.zeros_like(recorded().position))
    with pytest.raises(RecordingError, match="moves in too few samples"):
        identify([still], model())
    undriven = replace(recorded(), current=np.zeros_like(recorded().current))
    with pytest.raises(RecordingError, match="the current is 0 A"):
        identify([undriven], model())
