"""Energies of runs estimated from counts and currents, against the exact ledger of the same motion."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.config import Config, apply_settings, load_config
from hapticd.record import RunWriter, read_run
from hapticd.record.errors import RunFileError
from hapticd.record.schema import FLAG_RUNNING, Rows
from hapticd.servo.simulate import simulate
from hapticd.stability.energy_records import model_of
from hapticd.stability.energy_replay import EnergyEstimate
from hapticd.stability.ledger import Ledger, ledger
from hapticd.stability.numbers import from_config
from hapticd.stability.passivity import spring_potential
from hapticd.stability.run_energy import RunEnergy, run_energy

IDEAL = {"amplifier.bandwidth_hz": 0, "amplifier.dac_bits": 0, "encoder.decimation": 217}
CASES: dict[str, tuple[dict[str, object], dict[str, Any]]] = {
    "stops": ({}, {"deflection": 20.3}),
    "buzzes": ({"encoder.decimation": 2172}, {"deflection": 3.3}),
    "grows": ({"servo.rate_hz": 100}, {"velocity": 5.0}),
    "lag of the amplifier": ({"amplifier.bandwidth_hz": 3000}, {"deflection": 20.3}),
    "lag of more than a period": ({"amplifier.bandwidth_hz": 150}, {"deflection": 9.4}),
    "late by more than a period": ({"delay.computation_s": 1.25e-3}, {"deflection": 20.3}),
    "late by whole periods": ({"delay.computation_s": 2e-3}, {"velocity": 2.0}),
    "held by a hand": ({"hand.stiffness": 0.004, "hand.damping": 1e-5, "hand.inertia": 1e-6}, {"deflection": 20.3}),
}


def make(settings: dict[str, object]) -> Config:
    return apply_settings(load_config(None), {**IDEAL, **settings})


def recorded(config: Config, motion: dict[str, Any], duration: float = 0.3) -> Rows:
    blocks: list[Any] = []
    simulate(config, duration, on_rows=lambda rows: blocks.append(rows.copy()), **motion)
    return np.concatenate(blocks)


def written(
    path: Path, config: Config, rows: Rows, *, events: tuple[dict[str, Any], ...] = (), **metadata: Any
) -> Path:
    with RunWriter(path, {"config": config.model_dump(mode="json"), **metadata}) as writer:
        first = 0
        for event in events:
            writer.write(rows[first : event["row"]])
            first = event.pop("row")
            writer.annotate(event)
        writer.write(rows[first:])
    return path


def exact(config: Config, motion: dict[str, Any], rows: Rows) -> Ledger:
    return ledger(from_config(config), motion.get("deflection", 0.0), motion.get("velocity", 0.0), rows.size)


@pytest.fixture
def case(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[RunEnergy, Ledger]:
    settings, motion = CASES[request.param]
    config = make(settings)
    rows = recorded(config, motion)
    return run_energy(read_run(written(tmp_path / "run.arrow", config, rows))), exact(config, motion, rows)


@pytest.mark.parametrize("case", CASES, indirect=True)
def test_an_ideal_recording_gives_the_energies_of_the_exact_motion(case: tuple[RunEnergy, Ledger]) -> None:
    found, truth = case
    # the ledger's ends lie at h + τ_D and the rows' at h: sum the ledger up to the last of them
    until = int(np.searchsorted(truth.tau, found.time_s.size - 1.0, side="right")) - 1
    scale = float(np.abs(truth.generated[:until]).sum() + truth.dissipated[:until].sum()) * found.unit
    early = until - max(0, round(truth.numbers.tau_d) + 1)
    # ledger and estimate take a current loop for its delay; at 150 Hz, δ = 0.7 that makes a few per cent
    share = 0.03 if 1.4 < truth.numbers.tau_d < 1.6 else 0.01
    for value, sums in (
        (found.energies["viscous"][-1], truth.viscous),
        (found.energies["coulomb"][-1], truth.coulomb),
        (found.energies["generated"][-1], truth.generated),
    ):
        between = sorted((sums[:early].sum() * found.unit, sums[: until + 1].sum() * found.unit))
        assert between[0] - share * scale <= value <= between[1] + share * scale
    assert found.energies["stored"][0] == pytest.approx(truth.stored[0] * found.unit, rel=0.02)
    assert abs(found.unexplained[-1]) <= 0.005 * scale
    assert found.explained is not None
    assert found.explained > 0.98
    assert np.abs(found.residual).max() <= 1e-12 * (found.energies["stored"].max() + scale)


@pytest.mark.parametrize("case", CASES, indirect=True)
def test_the_bounds_that_hold_hold_in_every_run(case: tuple[RunEnergy, Ledger]) -> None:
    found, _ = case
    assert found.bounds is not None
    assert found.bounds.displacement.size > found.time_s.size - 8
    assert found.bounds.violations.size < found.bounds.displacement.size


@pytest.mark.parametrize("case", ["stops"], indirect=True)
def test_the_papers_bound_is_counted_where_it_fails(case: tuple[RunEnergy, Ledger]) -> None:
    found, _ = case
    assert found.report["bounds"]["violations"]["paper"] > 10
    assert 0.05 < found.report["bounds"]["largest_excess_in_unit"]["paper"] <= 0.125 + 1e-9
    assert found.report["estimate"].startswith("through the model")


def test_a_wrong_model_shows_as_unexplained_energy(tmp_path: Path) -> None:
    config = make({})
    rows = recorded(config, {"deflection": 20.3})
    wrong = apply_settings(config, {"plant.coulomb": 1e-3})
    honest = run_energy(read_run(written(tmp_path / "a.arrow", config, rows)))
    fooled = run_energy(read_run(written(tmp_path / "b.arrow", wrong, rows)))
    assert honest.explained is not None
    assert fooled.explained is not None
    assert fooled.explained < 0.9 < 0.99 < honest.explained
    # half the Coulomb friction: the other half is missing
    assert fooled.unexplained[-1] == pytest.approx(-0.5 * honest.energies["coulomb"][-1], rel=0.1)


@pytest.mark.parametrize(
    ("settings", "inside", "outside"),
    [
        ({"spring.half_tick_bias": "false"}, [(2.25, 1.5), (-0.5, 0.5)], []),
        ({"spring.side": "positive"}, [(2.25, 2.625)], [-0.5]),
        ({"spring.side": "negative"}, [(-1.5, 1.25)], [0.5]),
    ],
)
def test_potential_of_other_springs(
    settings: dict[str, object], inside: list[tuple[float, float]], outside: list[float]
) -> None:
    model = model_of(make(settings))
    bias, side = float(model["bias"]), float(model["side"])
    for xi, expected in [*inside, *((xi, 0.0) for xi in outside)]:
        assert spring_potential(xi, bias, side) == pytest.approx(expected)


def test_what_is_read_in_chunks_is_what_is_read_at_once() -> None:
    config = make({"amplifier.bandwidth_hz": 150})
    rows = recorded(config, {"deflection": 20.3})
    whole, parts = EnergyEstimate(config), EnergyEstimate(config)
    whole.update(rows)
    for first in range(0, rows.size, 7):
        parts.update(rows[first : first + 7])
    parts.update(rows[:0])
    assert parts.status() == whole.status()


def test_every_start_begins_anew_and_a_stop_keeps_the_sums() -> None:
    config = make({})
    rows = recorded(config, {"deflection": 20.3}, 0.9)  # at rest in the end
    once = EnergyEstimate(config)
    once.update(rows)
    idle = rows[-20:].copy()
    idle["tick"] += 20
    idle["time_s"] += 20 * config.period
    idle["flags"] &= ~FLAG_RUNNING
    idle["current_command_A"] = 0.0
    before = once.status()
    once.update(idle)
    after = once.status()
    assert after == before
    again = idle.copy()
    again["tick"] += 20
    again["time_s"] += 20 * config.period
    again["flags"] |= FLAG_RUNNING
    once.update(again[:1])
    assert once.status()["dissipated_J"] == once.status()["generated_J"] == 0.0


def test_of_several_starts_the_last_is_accounted_for(tmp_path: Path) -> None:
    config = make({})
    rows = recorded(config, {"deflection": 20.3}, 0.1)
    rows["flags"][:2] = rows["flags"][40:45] = 0
    found = run_energy(read_run(written(tmp_path / "run.arrow", config, rows)))
    assert found.time_s[0] == rows["time_s"][45]
    assert any("started more than once" in note for note in found.notes)
    rows["flags"][:45] = 0
    assert run_energy(read_run(written(tmp_path / "late.arrow", config, rows))).notes == ()


def test_changed_settings_are_booked_as_such() -> None:
    config = make({})
    rows = recorded(config, {"deflection": 20.3}, 0.02)
    estimate = EnergyEstimate(config)
    estimate.update(rows)
    before = estimate.status()
    stiffer = apply_settings(config, {"spring.stiffness": 0.024})
    estimate.configure(stiffer, origin_counts=217)
    after = estimate.status()
    assert after["settings_J"] == pytest.approx(after["stored_J"] - before["stored_J"])
    assert after["settings_J"] > 0.0
    assert estimate.origin_counts == 217


def test_settings_changed_in_a_run_are_followed(tmp_path: Path) -> None:
    config = make({})
    rows = recorded(config, {"deflection": 20.3}, 0.1)
    event = {"row": 50, "event": "set", "tick": 50, "changed": {"spring.stiffness": 0.024}}
    found = run_energy(read_run(written(tmp_path / "run.arrow", config, rows, events=(event,))))
    assert any("settings were changed" in note for note in found.notes)
    assert np.abs(found.residual).max() <= 1e-12 * found.energies["stored"].max()
    assert found.bounds is not None
    assert found.bounds.displacement.size < 51


def test_lost_rows_do_not_throw_the_model_off() -> None:
    config = make({})
    rows = recorded(config, {"deflection": 20.3})
    kept = np.concatenate((rows[:60], rows[90:]))
    whole, holey = EnergyEstimate(config), EnergyEstimate(config)
    whole.update(rows)
    holey.update(kept)
    assert holey.status()["stored_J"] == pytest.approx(whole.status()["stored_J"], rel=0.05)


def test_a_foreign_file_needs_a_config(tmp_path: Path) -> None:
    config = make({})
    rows = recorded(config, {"deflection": 20.3})
    position = rows["encoder_counts"] * config.raw_resolution + 1e-6
    force = rows["current_command_A"] * config.amplifier.torque_constant
    lines = [f"{t:.9g},{x:.12g},{f:.12g}" for t, x, f in zip(rows["time_s"], position, force, strict=True)]
    path = tmp_path / "foreign.csv"
    path.write_text("\n".join(["time_s,position,force", *lines]))
    with pytest.raises(RunFileError, match="carries no config"):
        run_energy(read_run(path))
    estimate = EnergyEstimate(config)
    estimate.update(rows)
    found = run_energy(read_run(path), config)
    assert found.energies["generated"][-1] == pytest.approx(estimate.status()["generated_J"], rel=1e-6)


def test_a_run_without_a_spring_has_no_ledger(tmp_path: Path) -> None:
    config = make({"spring.stiffness": 0})
    rows = recorded(config, {"velocity": 1.0}, 0.02)
    with pytest.raises(RunFileError, match=r"spring\.stiffness is 0"):
        run_energy(read_run(written(tmp_path / "a.arrow", config, rows)))
    rows["flags"] = 0
    with pytest.raises(RunFileError, match="never rendered"):
        run_energy(read_run(written(tmp_path / "b.arrow", make({}), rows)))


def test_other_springs_have_a_ledger_but_no_bounds(tmp_path: Path) -> None:
    config = make({"spring.side": "positive"})
    rows = recorded(config, {"deflection": 9.4}, 0.1)
    found = run_energy(read_run(written(tmp_path / "run.arrow", config, rows)))
    assert found.bounds is None
    assert found.report["bounds"] is None
    assert any("bounds are not checked" in note for note in found.notes)
    assert found.explained is not None
    assert found.explained > 0.98
