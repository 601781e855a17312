"""Passivity observer and controller: what they book and add, from the rows by hand, and against the exact loop."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hapticd.config import Config, parse_config
from hapticd.record.schema import FLAG_CLAMPED, FLAG_EXCITATION
from hapticd.servo.excitation import build
from hapticd.servo.simulate import simulate
from hapticd.stability.damping import Damper, passive_beta
from hapticd.stability.energy_replay import EnergyEstimate
from hapticd.stability.numbers import loop_from_config
from hapticd.stability.sampled_loop import run_loops
from tests.servo.scripted import Scripted, core_for, rows_of
from tests.servo.scripted import config as scripted_config
from tests.stability.motion import loop_record

CASE_D: dict[str, Any] = {"servo": {"rate_hz": 100}, "encoder": {"decimation": 217}}
IDEAL = {"bandwidth_hz": 0, "dac_bits": 0, "peak_current": None, "continuous_current": None}


def config(mode: str, **sections: Any) -> Config:
    return parse_config({**CASE_D, **sections, "safety": {"passivity": mode}}, "test")


def run(cfg: Config, duration_s: float, **motion: Any) -> tuple[Any, dict[str, Any]]:
    blocks: list[Any] = []
    found = simulate(cfg, duration_s, on_rows=lambda rows: blocks.append(rows.copy()), **motion)
    return np.concatenate(blocks), found


def potential(cfg: Config, counts: Any) -> Any:
    """Potential (34) of the staircase, summed count by count: the force in the middle between two counts is exact."""
    raw = cfg.raw_resolution
    grid = np.arange(-200_000, 200_001)
    force = cfg.spring.stiffness * cfg.resolution * (grid // cfg.encoder.decimation + 0.5)
    steps = 0.5 * (force[1:] + force[:-1]) * raw
    sums = np.concatenate([[0.0], np.cumsum(steps)])
    return sums[np.asarray(counts) + 200_000]


@pytest.mark.parametrize("delay_s", [0.0, 0.004, 0.02])
def test_the_observer_books_the_work_of_the_current_sent_less_what_the_spring_gives(delay_s: float) -> None:
    cfg = config("observe", delay={"computation_s": delay_s})
    rows, report = run(cfg, 0.4, deflection=10.3)
    counts, current = rows["encoder_counts"], rows["current_command_A"]
    work = (current[:-1] * cfg.amplifier.torque_constant * np.diff(counts) * cfg.raw_resolution).sum()
    generated = work + potential(cfg, counts[-1]) - potential(cfg, counts[0])
    assert report["passivity"]["put_out_J"] == pytest.approx(work, rel=1e-9)
    assert report["passivity"]["generated_J"] == pytest.approx(float(generated), rel=1e-9)
    assert generated > 0.0
    assert report["passivity"]["current"] == 0.0


def test_a_replay_of_the_rows_finds_the_same_energies_in_every_row() -> None:
    cfg = config("observe")
    rows, report = run(cfg, 0.4, deflection=10.3)
    energies, _ = EnergyEstimate(cfg).replayed(rows)
    assert energies["put_out"][-1] == pytest.approx(report["passivity"]["put_out_J"], rel=1e-12)
    assert energies["observed"][-1] == pytest.approx(report["passivity"]["generated_J"], rel=1e-12)
    half, short = run(cfg, 0.2, deflection=10.3)
    assert energies["observed"][len(half) - 1] == pytest.approx(short["passivity"]["generated_J"], rel=1e-12)


def test_observing_changes_nothing_and_off_books_nothing() -> None:
    off, report = run(config("off"), 0.4, deflection=10.3)
    observed, _ = run(config("observe"), 0.4, deflection=10.3)
    assert off.tobytes() == observed.tobytes()
    assert "passivity" not in report


def test_the_controller_brings_case_d_to_rest() -> None:
    _, wild = run(config("observe"), 1.0, deflection=10.3)
    rows, calm = run(config("control"), 3.0, deflection=10.3)
    assert wild["outcome"] == "growing"
    assert calm["outcome"] in ("monotone", "decaying")
    assert calm["passivity"]["dissipated_J"] > 0.0
    assert np.abs(rows["encoder_counts"]).max() < 11 * 217


def test_it_keeps_within_the_peak_current() -> None:
    """A shaft that is pushed outwards: spring and controller pull the same way."""

    def currents(peak: float) -> Any:
        cfg = scripted_config(
            amplifier={"peak_current": peak, "continuous_current": 0.3},
            safety={"passivity": "control", "encoder_jump": 0},
        )
        core = core_for(Scripted(cfg, lambda n: 0 if n < 5 else min(200 * (n - 4), 1000)), cfg)
        return rows_of(core, 12)

    free, limited = currents(6.0), currents(0.33)
    assert np.abs(free["current_command_A"]).max() > 0.34
    assert np.abs(limited["current_command_A"]).max() == 0.33
    assert not (limited["flags"] & FLAG_CLAMPED).any()
    assert (free["encoder_counts"] == limited["encoder_counts"]).all()


@pytest.mark.parametrize("delay_s", [0.0, 0.0125])
@pytest.mark.parametrize("damping", [0.0, 5e-5])
def test_the_servo_does_what_the_exact_loop_does(delay_s: float, damping: float) -> None:
    cfg = config("control", amplifier=IDEAL, delay={"computation_s": delay_s}, spring={"damping": damping})
    numbers = loop_from_config(cfg).numbers
    damper = Damper(damping / (cfg.spring.stiffness * cfg.period))
    loops = loop_record(numbers, damper, np.array([10.3]), np.zeros(1))
    loops["counts"], loops["stiffest"] = 217, 2.0 * passive_beta(numbers, damper)
    for periods in (12, 60):
        found = run_loops(loops, periods)[0]
        final = simulate(cfg, periods / 100.0, deflection=10.3)["final"]
        assert final["position_ticks"] == pytest.approx(found["xi"], rel=1e-9, abs=1e-7)
    assert found["added"] > 0.0


def test_what_an_excitation_puts_in_is_not_booked() -> None:
    cfg = config("control")
    table = build(cfg, "steps", duration_s=1.0)
    rows, report = run(cfg, 0.9, excitation=table)
    assert (rows["flags"] & FLAG_EXCITATION).all()
    assert np.ptp(rows["encoder_counts"]) > 0
    assert report["passivity"] == {
        "put_out_J": 0.0, "generated_J": 0.0, "excess_J": 0.0, "dissipated_J": 0.0, "current": 0.0
    }  # fmt: skip
