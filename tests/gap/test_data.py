"""From run files of every kind to the arrays that the workflow reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hapticd.config import load_config
from hapticd.gap.data import load_recording, step_of
from hapticd.gap.errors import RecordingError
from hapticd.gap.recording import Recording
from hapticd.record import RunFileError, RunWriter, import_run, parse_map, run_metadata
from hapticd.record.schema import FLAG_MISSED_EXCHANGE, Rows, empty_rows

from .synthetic import COUNTS, model

CELL = 2 * np.pi / COUNTS


def rows(count: int = 3000) -> Rows:
    made = empty_rows(count)
    made["tick"] = np.arange(count)
    made["time_s"] = 4.0 + made["tick"] * 1e-3
    made["encoder_counts"] = np.floor(500 * np.sin(0.01 * made["tick"]))
    made["current_command_A"] = np.cos(0.01 * made["tick"])
    made["current_measured_A"] = np.nan
    made["flags"] = 1
    return made


def native(path: Path, made: Rows, counts_per_rev: int = COUNTS) -> Path:
    config = load_config().model_dump(mode="json")
    config["encoder"]["counts_per_rev"] = counts_per_rev
    with RunWriter(path, run_metadata(config)) as writer:
        writer.write(made)
    return path


def test_native_run(tmp_path: Path) -> None:
    made = rows()
    found = load_recording(native(tmp_path / "r.arrow", made), model())
    assert found.time_s[0] == 0.0
    assert np.allclose(found.time_s, np.arange(3000) * 1e-3, atol=1e-12)
    assert np.array_equal(found.position, (made["encoder_counts"] + 0.5) * CELL)
    assert np.array_equal(found.current, made["current_command_A"])
    assert found.current_measured is None
    assert (found.name, found.is_linear, found.resolution) == ("r.arrow", False, CELL)
    assert found.period_s == pytest.approx(1e-3)


def test_the_run_knows_its_encoder_better_than_the_model(tmp_path: Path) -> None:
    found = load_recording(native(tmp_path / "r.arrow", rows(), 4096), model())
    assert found.resolution == pytest.approx(2 * CELL)


def test_positions_are_as_the_model_s_encoder_counts(tmp_path: Path) -> None:
    """Also those of a file that does not say how it was counted: as by the encoder itself."""
    made = rows()
    config = model()
    inverted = config.model_copy(update={"encoder": config.encoder.model_copy(update={"invert": True})})
    run, table = native(tmp_path / "r.arrow", made), tmp_path / "r.csv"
    columns = ("time_s", "encoder_counts", "current_command_A")
    np.savetxt(table, np.column_stack([made[c] for c in columns]), "%.17g", ",", header=",".join(columns), comments="")
    for path in (run, table):
        turned = load_recording(path, inverted)
        assert np.array_equal(turned.position, -load_recording(path, config).position)
        assert any("positions are turned round" in warning for warning in turned.warnings)
    in_rad, radians = tmp_path / "rad.csv", 1e-3 * made["encoder_counts"]
    rows_of = np.column_stack([made["time_s"], radians, made["current_command_A"]])
    np.savetxt(in_rad, rows_of, "%.17g", ",", header="time_s,position,current_command_A", comments="")
    assert np.array_equal(load_recording(in_rad, inverted).position, radians), "the file says which way it goes"


def test_lateness_moves_the_samples(tmp_path: Path) -> None:
    made = rows()
    made["wake_late_ns"] = 1000 * (made["tick"] % 50)
    found = load_recording(native(tmp_path / "r.arrow", made), model())
    assert found.time_s[49] == pytest.approx(0.049 + 49e-6)


def test_imported_stamps_on_a_grid_are_spread(tmp_path: Path) -> None:
    """An imported run has a column for lateness, and nothing in it."""
    exact = np.arange(3000) / 997.0
    table = np.stack([np.floor(1e3 * exact) / 1e3, np.floor(500 * np.sin(3.0 * exact)), np.cos(3.0 * exact)], axis=1)
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,q,i", comments="", fmt="%.17g")
    mapping = {
        "device": "rotary",
        "time": {"column": "t"},
        "position": {"column": "q", "unit": "count"},
        "current": {"column": "i"},
        "encoder": {"counts_per_rev": COUNTS},
    }
    done = import_run(tmp_path / "log.csv", parse_map(mapping, "map.yaml"), tmp_path / "run.arrow")
    found = load_recording(done.path, model())
    assert found.period_s == pytest.approx(1.0 / 997.0, rel=1e-4)
    assert any("grid of 1 ms" in warning for warning in found.warnings)


def test_missing_rows_are_no_grid(tmp_path: Path) -> None:
    made = rows()
    found = load_recording(native(tmp_path / "r.arrow", np.delete(made, [90, 400, 1307, 1310, 2900])), model())
    assert not any("grid" in warning for warning in found.warnings)


def test_a_failed_exchange_is_no_measurement(tmp_path: Path) -> None:
    made = rows()
    made["encoder_counts"][100] = made["encoder_counts"][99]
    made["flags"][100] |= FLAG_MISSED_EXCHANGE
    found = load_recording(native(tmp_path / "r.arrow", made), model())
    assert found.position[100] == pytest.approx(0.5 * (found.position[99] + found.position[101]))


def test_csv_with_position_and_force(tmp_path: Path) -> None:
    time = np.arange(3000) * 1e-3
    position = 0.5 * CELL + CELL * np.floor(400 * np.sin(3 * time))
    force = 0.01 * np.cos(3 * time)
    path = tmp_path / "r.csv"
    table = np.stack([time, position, force], axis=1)
    np.savetxt(path, table, delimiter=",", header="time_s,position,force", comments="", fmt="%.17g")
    found = load_recording(path, model())
    assert found.resolution == pytest.approx(CELL)
    assert np.allclose(found.current, force / 0.03)


def test_positions_of_another_clock_are_used_when_they_were_sampled(tmp_path: Path) -> None:
    made = rows(6000)
    sampled_s = made["time_s"] - np.mod(made["time_s"], 1.15e-3)
    made["encoder_counts"] = np.floor(5000.0 * np.sin(10.0 * sampled_s))
    found = load_recording(native(tmp_path / "r.arrow", made), model())
    assert found.period_s == pytest.approx(1.15e-3, rel=1e-5)
    assert found.rows == pytest.approx(6000 / 1.15, rel=0.03)
    start_s = np.unique(sampled_s)[0]
    assert found.position == pytest.approx(5000.0 * CELL * np.sin(10.0 * (start_s + found.time_s)), abs=1.2 * CELL)
    (said,) = (warning for warning in found.warnings if "clock" in warning)
    assert said == (
        "r.arrow: the positions have a clock of their own, with a period of 1.15 ms (1.150 of the record's): the record is "
        "used at the times of its samples"
    )


def test_steps_of_positions_without_a_known_encoder() -> None:
    position = 1e-4 * np.array([0.0, 3.0, 7.0, 8.0, 2.0])
    assert step_of(position, CELL) == pytest.approx(1e-4)
    assert step_of(np.sin(np.arange(50.0)), CELL) == 0.0
    assert step_of(np.zeros(5), CELL) == 0.0


def test_linear_runs_need_linear_models(tmp_path: Path) -> None:
    config = {"encoder": {"counts_per_rev": None, "counts_per_metre": 1e6}}
    with RunWriter(tmp_path / "r.arrow", run_metadata(config)) as writer:
        writer.write(rows())
    with pytest.raises(RecordingError, match=r"a run of a linear device \(m, N\), but the model is a rotary device"):
        load_recording(tmp_path / "r.arrow", model())


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(RunFileError, match="cannot read"):
        load_recording(tmp_path / "none.arrow", model())


def test_duration_and_rows(nominal_run: Recording) -> None:
    assert nominal_run.rows == 20_000
    assert nominal_run.duration_s == pytest.approx(19.999)
