"""Missing torque against runs whose hidden torque is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hapticd.gap.data import Recording
from hapticd.gap.force import force_residual, force_signals

from .synthetic import COULOMB, PERIOD, TORQUE_CONSTANT, VISCOUS, model, run


def test_nothing_is_missing_from_the_nominal_device(nominal_run: Recording) -> None:
    score = force_residual(nominal_run, model())
    assert score.rms < 0.1 * COULOMB
    assert abs(score.residual.mean()) < 0.01 * COULOMB
    assert score.cv_rms == pytest.approx(score.rms, rel=0.05)


def test_a_hidden_push_is_the_residual() -> None:
    pushed = run(lambda angle, velocity, time: 5e-4 * math.sin(2 * math.pi * 1.5 * time))
    score = force_residual(pushed, model())
    expected = 5e-4 * np.sin(2 * np.pi * 1.5 * score.time_s)
    gain = float(score.residual @ expected / (expected @ expected))
    assert gain == pytest.approx(1.0, abs=0.03)


def test_residual_is_the_balance_of_its_regressors(nominal_run: Recording) -> None:
    score = force_residual(nominal_run, model())
    parts = score.regressors
    assert np.allclose(score.residual, parts["inertia"] + parts["viscous"] + parts["coulomb"] - parts["drive"])
    assert parts["viscous"].std() == pytest.approx(VISCOUS * score.signals.filtered(score.signals.velocity).std())


def test_filtering_the_sign_beats_the_sign_of_the_filtered(nominal_run: Recording) -> None:
    score = force_residual(nominal_run, model())
    signals = score.signals
    pointwise = np.sign(signals.filtered(signals.velocity)) * COULOMB
    inflated = score.residual - score.regressors["coulomb"] + pointwise
    assert np.sqrt(np.mean(inflated**2)) > 1.47 * score.rms


def test_rows_at_rest_do_not_count() -> None:
    stopped = run(seconds=12.0, centring=0.0)
    rest = stopped.time_s > 8.0
    position = np.where(rest, stopped.position[~rest][-1], stopped.position)
    halted = Recording(
        "h", stopped.time_s, position, stopped.resolution, stopped.current, None, PERIOD, None, False, None
    )
    signals = force_signals(halted, model())
    assert signals.time_s.max() < 8.2
    assert not signals.moving[halted.time_s > 8.2].any()


def test_stiction_is_not_taken_for_missing_torque() -> None:
    sticking = run(size=0.07)
    score = force_residual(sticking, model())
    held = ~score.signals.moving
    assert held.mean() > 0.3
    assert np.abs(TORQUE_CONSTANT * sticking.current[held]).max() > 0.8 * COULOMB  # what would be the residual there
    assert score.rms < 0.1 * COULOMB


def test_a_delay_in_the_model_moves_the_drive(nominal_run: Recording) -> None:
    early = force_residual(nominal_run, model(), delay_s=0.0)
    late = force_residual(nominal_run, model(), delay_s=0.004)
    assert late.rms > 1.2 * early.rms


def test_a_shaft_that_rests_has_no_balance() -> None:
    still = run(seconds=3.0)
    frozen = Recording("f", still.time_s, 0 * still.position, 1e-3, still.current, None, PERIOD, None, False, None)
    with pytest.raises(ValueError, match="rows in motion are too few"):
        force_signals(frozen, model(), bandwidth_hz=40.0)
