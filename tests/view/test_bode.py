"""Frequency responses of a chirp: of a plant that is known, they are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hapticd.config import apply_settings, load_config
from hapticd.record import Run, RunFileError, RunWriter, read_run, run_metadata
from hapticd.servo.excitation import build
from hapticd.servo.simulate import simulate
from hapticd.view.bode import SEEN, bode, difference

FREE = {"plant.coulomb": 0.0, "encoder.counts_per_rev": 2_000_000, "spring.stiffness": 0.012}


def chirp(folder: Path, amplitude: float, **settings: float) -> Run:
    named = {key.replace("__", "."): value for key, value in settings.items()}
    config = apply_settings(load_config(None), named)
    table = build(config, "chirp", duration_s=12, amplitude=amplitude, low_hz=1, high_hz=100)
    path = folder / "chirp.arrow"
    with RunWriter(path, {**run_metadata(config.model_dump(mode="json")), "kind": "run", "label": "chirp"}) as writer:
        simulate(config, 12.0, excitation=table, on_rows=writer.write)
    return read_run(path)


def test_a_linear_device_is_what_theory_says(tmp_path: Path) -> None:
    free = {key.replace(".", "__"): value for key, value in FREE.items()}
    found = bode(chirp(tmp_path, 0.05, **free, plant__viscous=1e-3))
    assert found.hz[0] < 2.0
    assert found.hz[-1] > 70.0
    for curve in (found.device, found.impedance):
        assert np.median(curve.coherence) > 0.98
        against = difference(curve.measured, curve.theory, curve.coherence)
        assert against["frequencies"] > 0.8 * found.hz.size
        assert against["magnitude_db"] < 0.4
        assert against["phase_deg"] < 3.0
    # at its resonance the impedance is that of the damper alone, seen from both sides
    lowest = found.hz[np.argmin(np.abs(found.impedance.measured))]
    assert lowest == pytest.approx(np.sqrt(0.012 / 6.28e-6) / (2 * np.pi), rel=0.15)


def test_with_friction_the_simulated_model_is_nearer_than_the_linear_theory(tmp_path: Path) -> None:
    run = chirp(tmp_path, 0.4)
    found = bode(run)
    for curve in (found.device, found.impedance):
        near = curve.document["difference"]
        far = difference(curve.measured, curve.theory, curve.coherence)
        assert near["magnitude_db"] < 0.5
        assert near["phase_deg"] < 0.3 * far["phase_deg"]


def test_another_model_is_farther(tmp_path: Path) -> None:
    run = chirp(tmp_path, 0.4)
    heavier = apply_settings(load_config(None), {"plant.inertia": 1.2e-5})
    own, other = bode(run).device.document["difference"], bode(run, heavier).device.document["difference"]
    assert own["magnitude_db"] < 1.0 < other["magnitude_db"]


def test_skipped_periods_are_filled_and_said(tmp_path: Path) -> None:
    run = chirp(tmp_path, 0.4)
    kept = np.ones(run.rows, dtype=bool)
    kept[[500, 501, 3000]] = False
    found = bode(replace(run, columns={name: values[kept] for name, values in run.columns.items()}))
    assert found.filled == 3
    assert found.device.document["difference"]["magnitude_db"] < 1.0


def test_a_run_without_a_chirp_is_refused(tmp_path: Path) -> None:
    run = chirp(tmp_path, 0.4)
    flags = np.zeros_like(run.columns["flags"])
    with pytest.raises(RunFileError, match="'hapticd excite chirp' records one"):
        bode(replace(run, columns={**run.columns, "flags": flags}))
    with pytest.raises(RunFileError, match="has no column tick"):
        bode(replace(run, columns={name: run.columns[name] for name in run.columns if name != "tick"}))


def test_difference_looks_only_where_it_is_coherent() -> None:
    found, model = np.array([1.0 + 0j, 10.0]), np.array([1.0 + 0j, 1.0])
    assert difference(found, model, np.array([1.0, SEEN / 2]))["magnitude_db"] == 0.0
    assert difference(found, model, np.array([0.0, 0.0])) == {"magnitude_db": None, "phase_deg": None, "frequencies": 0}
