"""The velocity that the damping goes by, from scripted counts: windows, gaps, origins, walls."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hapticd.servo.core import Request, parameters
from hapticd.servo.law import spring
from tests.servo.scripted import Scripted, config, core_for, rows_of

B = 1e-4


def damping_force(counts: Callable[[int], int | None], ticks: int = 30, **spring_keys: Any) -> Any:
    """Force of the damping alone in every rendered tick, N m, and the raw counts beside it."""
    cfg = config(spring={"stiffness": 0.0, "damping": B, **spring_keys}, safety={"encoder_jump": 0, "max_velocity": 0})
    rows = rows_of(core_for(Scripted(cfg, counts), cfg), ticks)
    rendered = rows[rows["flags"] & 1 != 0]
    return rendered["force_command"], rendered["encoder_counts"] * cfg.raw_resolution


def test_one_period_is_the_difference_of_the_last_two_positions() -> None:
    force, position = damping_force(lambda n: n * n)
    assert force[0] == 0.0
    assert force[1:] == pytest.approx(-B * np.diff(position) * 1000.0, rel=1e-12)


def test_a_window_is_the_mean_over_it_and_grows_from_the_start() -> None:
    force, position = damping_force(lambda n: n * n, velocity_periods=5)
    for k in range(1, len(force)):
        n = min(k, 5)
        assert force[k] == pytest.approx(-B * (position[k] - position[k - n]) / (n * 1e-3), rel=1e-12)


def test_the_low_pass_is_of_first_order() -> None:
    force, position = damping_force(lambda n: n * n, velocity_estimate="low_pass", velocity_cutoff_hz=40.0)
    keep, velocity = np.exp(-2.0 * np.pi * 40.0 * 1e-3), 0.0
    for k in range(1, len(force)):
        velocity = keep * velocity + (1.0 - keep) * (position[k] - position[k - 1]) * 1000.0
        assert force[k] == pytest.approx(-B * velocity, rel=1e-12)


def test_a_failed_exchange_holds_the_estimate_and_then_spans_the_gap() -> None:
    force, _ = damping_force(lambda n: None if n == 10 else 8 * n)
    assert force[2:] == pytest.approx(np.full(len(force) - 2, force[2]), rel=1e-12)


def test_it_sees_coarse_ticks_counted_from_the_origin() -> None:
    cfg = config(
        spring={"stiffness": 0.0, "damping": B, "origin": 0.01},
        encoder={"decimation": 50},
        safety={"encoder_jump": 0, "max_velocity": 0},
    )
    rows = rows_of(core_for(Scripted(cfg, lambda n: 7 * n), cfg), 40)
    rendered = rows[rows["flags"] & 1 != 0]
    ticks = (rendered["encoder_counts"] - cfg.origin_counts) // 50
    assert set(np.diff(ticks)) == {0, 1}
    assert rendered["force_command"][1:] == pytest.approx(-B * np.diff(ticks) * cfg.resolution * 1000.0, rel=1e-12)


def test_a_moved_origin_is_no_velocity() -> None:
    cfg = config(spring={"damping": B, "stiffness": 0.0}, safety={"encoder_jump": 0})
    core = core_for(Scripted(cfg, lambda n: 500), cfg)
    rows_of(core, 10)
    core.publish(parameters(cfg, Request(state=2, origin_counts=123)))
    assert not rows_of(core, 5)["force_command"].any()


@pytest.mark.parametrize(("side", "relative", "velocity"), [("positive", 20, -1e9), ("negative", -20, 1e9)])
def test_a_wall_never_pulls(side: str, relative: int, velocity: float) -> None:
    both = parameters(config(spring={"damping": B}), Request())
    wall = parameters(config(spring={"damping": B, "side": side}), Request())
    free = spring(both, both, relative, 0.0, velocity)
    held = spring(wall, wall, relative, 0.0, velocity)
    assert free * relative > 0.0
    assert held == 0.0
    assert spring(wall, wall, relative, 0.0, -velocity) == spring(both, both, relative, 0.0, -velocity)


def test_no_damping_takes_no_history() -> None:
    cfg = config()
    core = core_for(Scripted(cfg, lambda n: n), cfg)
    rows_of(core, 20)
    assert core.memory[0]["state"]["velocity_samples"] == 0
