"""The loop's own sample-to-current delay, measured from a recording; and T_V, any fraction or multiple of a period."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hapticd.config import Config
from hapticd.plant.exact import propagate
from hapticd.record.schema import ROW
from hapticd.servo.simulate import simulate
from tests.servo.scripted import config

FAST = {"servo": {"rate_hz": 1000}, "encoder": {"decimation": 20}, "spring": {"stiffness": 0.1}}


def recording(cfg: Config, duration_s: float, deflection: float) -> NDArray[Any]:
    """Rows of a simulation."""
    blocks: list[NDArray[Any]] = []
    simulate(cfg, duration_s, deflection=deflection, on_rows=lambda rows: blocks.append(rows.copy()))
    return np.concatenate(blocks) if blocks else np.zeros(0, ROW)


def mismatches(cfg: Config, rows: NDArray[Any], delay_periods: float, deflection: float) -> int:
    """How many recorded counts another plant does not reproduce when row k's force acts from time k + delay on."""
    period, plant = cfg.period, cfg.plant
    whole, part = int(delay_periods), delay_periods - int(delay_periods)
    forces = rows["force_command"]
    x, v, wrong = deflection * cfg.resolution, 0.0, 0
    for k in range(len(rows)):
        wrong += int(np.floor(x / cfg.raw_resolution)) != rows["encoder_counts"][k]
        before = forces[k - whole - 1] if k - whole - 1 >= 0 else 0.0
        after = forces[k - whole] if k - whole >= 0 else 0.0
        if part > 0.0:
            x, v = propagate(x, v, part * period, before, plant.inertia, plant.viscous, plant.coulomb)
        x, v = propagate(x, v, (1.0 - part) * period, after, plant.inertia, plant.viscous, plant.coulomb)
    return wrong


@pytest.mark.parametrize("configured", [0.0, 0.3, 1.0, 1.6])
def test_measured_delay_is_the_configured_one(configured: float) -> None:
    cfg = config(**FAST, delay={"computation_s": configured * 1e-3})
    rows = recording(cfg, 0.08, 30.4)
    candidates = [0.0, 0.15, 0.3, 0.5, 1.0, 1.15, 1.6, 2.0]
    wrong = {delay: mismatches(cfg, rows, delay, 30.4) for delay in candidates}
    assert min(wrong, key=lambda delay: wrong[delay]) == configured
    assert wrong[configured] == 0
    assert all(count > 10 for delay, count in wrong.items() if delay != configured)


def test_command_and_current_share_a_row_when_there_is_no_delay() -> None:
    rows = recording(config(**FAST), 0.05, 30.4)
    assert rows["current_command_A"] == pytest.approx(rows["force_command"] / 0.0292, rel=1e-14)


def test_whole_periods_of_delay_shift_the_current_by_rows() -> None:
    rows = recording(config(**FAST, delay={"computation_s": 3e-3}), 0.05, 30.4)
    assert (rows["current_command_A"][:3] == 0.0).all()
    assert rows["current_command_A"][3:] == pytest.approx(rows["force_command"][:-3] / 0.0292, rel=1e-14)


def test_a_hidden_period_makes_case_c_grow() -> None:
    """The classic mistake, made on purpose: one period of delay turns Fig. 8 c from stable to unstable."""
    case_c: dict[str, Any] = {"servo": {"rate_hz": 100}, "encoder": {"decimation": 217}}
    assert simulate(config(**case_c), 5.0, deflection=2.3)["outcome"] == "monotone"
    hidden = simulate(config(**case_c, delay={"computation_s": 0.01}), 60.0, deflection=2.3)
    assert hidden["outcome"] == "growing"


def test_declared_amplifier_lag_is_part_of_the_plant() -> None:
    """A current loop of second order, as the effect is, down to the last count; T_A = 2 δ/ω is near."""
    amplifier = {"bandwidth_hz": 500, "damping_ratio": 0.7}
    with_amplifier = recording(config(**FAST, amplifier=amplifier), 0.1, 30.4)["encoder_counts"]
    effect = {"name": "amplifier_lag", "f_a": 500, "delta": 0.7}
    with_effect = recording(config(**FAST, plant={"effects": [effect]}), 0.1, 30.4)["encoder_counts"]
    lag = 2 * 0.7 / (2 * np.pi * 500.0)
    with_delay = recording(config(**FAST, delay={"computation_s": lag}), 0.1, 30.4)["encoder_counts"]
    assert lag == pytest.approx(0.446e-3, abs=1e-6)
    assert list(with_amplifier) == list(with_effect)
    assert np.abs(with_amplifier - with_delay)[:20].max() <= 3
    assert (with_amplifier != with_delay).any()
