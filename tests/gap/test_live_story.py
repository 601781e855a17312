"""The whole circle on a device in a process of its own, whose plant file says what nobody told the daemon."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest

from hapticd.config import load_config
from hapticd.servo.experiment import read_experiment
from tests.forked import fork_what_hil_starts
from tests.gap.hidden_effect import Claim, Story, find_hidden_effect

EXAMPLE = Path(__file__).parents[2] / "examples" / "missing_effect"
SECRET_DELAY_S = 0.002
PLAYS = 3

pytestmark = pytest.mark.realtime


@pytest.fixture(scope="module")
def story() -> Story:
    model, secret = load_config(EXAMPLE / "model.yaml"), load_config(EXAMPLE / "secret.yaml")
    assert [(effect.name, (effect.model_extra or {})["t_d"]) for effect in secret.plant.effects] == [
        ("transport_delay", SECRET_DELAY_S)
    ]
    # The pseudo-terminal of a busy machine hands samples over milliseconds late, without a stamp: such a play is repeated.
    for _ in range(PLAYS):
        with tempfile.TemporaryDirectory(prefix="hg-") as folder, pytest.MonkeyPatch.context() as patch:
            fork_what_hil_starts(patch)
            played = find_hidden_effect(model, secret, read_experiment(EXAMPLE / "first.yaml"), 31.3, Path(folder))
        agrees = _error(played.improved) < 0.5 * _error(played.nominal)
        if played.result.effects[:1] == ("transport_delay",) and agrees and _left_ahead(played) < 0.3:
            break
    return played


def _error(claim: Claim) -> float:
    return claim.comparison.current_rms_error


def _left_ahead(story: Story) -> float:
    """What is left of the error of predictions 50 ms ahead."""
    ahead = story.result.prediction["k_step"]
    return ahead["after"] / ahead["before"]


def test_the_nominal_model_says_it_comes_to_rest_and_the_device_runs_away(story: Story) -> None:
    assert story.nominal.region == "E"
    assert story.nominal.outcome in ("monotone", "decaying")
    assert story.outcome in ("growing", "persistent")


def test_the_secret_is_named_with_its_size(story: Story) -> None:
    assert story.result.effects[0] == "transport_delay"
    # The pseudo-terminal adds a delay of its own.
    assert story.result.steps[0].parameters["t_d"].value == pytest.approx(SECRET_DELAY_S, rel=0.25)
    assert _left_ahead(story) < 0.3


def test_the_improved_model_agrees_with_the_device(story: Story) -> None:
    assert story.improved.region == "D"
    assert story.improved.outcome == "growing"
    assert _error(story.improved) < 0.5 * _error(story.nominal)
