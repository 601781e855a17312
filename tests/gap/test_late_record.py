"""A record of the current that says later than it was what the motor had, or was filtered."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import find_gap, late_record
from hapticd.gap.recording import Recording
from hapticd.gap.series import series_of
from hapticd.gap.text import timing

ROWS = 2


def delayed(recording: Recording, rows: int = ROWS) -> Recording:
    """The same recording with the current of some rows before in each row."""
    current = np.concatenate([np.full(rows, recording.current[0]), recording.current[:-rows]])
    return replace(recording, current=current)


def filtered(recording: Recording, time_constant_s: float) -> Recording:
    """The same recording with its current behind a filter of first order."""
    current = np.empty_like(recording.current)
    known = recording.current[0]
    for k, duration in enumerate(np.diff(recording.time_s, append=np.inf)):
        current[k] = known
        known += (1.0 - np.exp(-duration / time_constant_s)) * (recording.current[k] - known)
    return replace(recording, current=current)


@pytest.mark.parametrize("effect", [None, {"name": "constant_bias", "tau_0": 6e-4}])
@pytest.mark.parametrize("filter_s", [0.01, 0.08])
def test_a_filtered_record_is_told_and_no_effect_is_named_for_it(
    hidden: Callable[..., Any], effect: Any, filter_s: float
) -> None:
    recording, model = hidden([effect] if effect else [], 29, 8.0)
    result = find_gap([filtered(recording, filter_s)], model, design=False)
    assert result.effects == (("constant_bias",) if effect else ()), result.statement
    found = result.recording["current_filter_s"]
    assert found["value"] == pytest.approx(filter_s, rel=0.02)
    assert found["ci95"][0] < found["value"] < found["ci95"][1]
    assert any("filtered before it was recorded" in warning for warning in result.warnings)
    assert f"its current filtered with {1e3 * found['value']:.3g} ms" in timing(result.to_json())


def test_a_filtered_record_may_be_late_besides(hidden: Callable[..., Any]) -> None:
    recording, model = hidden([{"name": "constant_bias", "tau_0": 6e-4}], 29, 8.0)
    result = find_gap([delayed(filtered(recording, 0.02), 3)], model, design=False)
    assert result.effects == ("constant_bias",), result.statement
    assert result.recording["current_filter_s"]["value"] == pytest.approx(0.02, rel=0.02)
    assert result.recording["current_late_s"]["value"] == pytest.approx(3.0 * recording.period_s, rel=0.05)


def test_base_parameters_are_fitted_behind_a_filter(hidden: Callable[..., Any]) -> None:
    recording, model = hidden([], 29, 8.0)
    inertia, coulomb = model.plant.inertia, model.plant.coulomb
    plant = model.plant.model_copy(update={"inertia": 1.5 * inertia, "coulomb": 0.6 * coulomb})
    wrong = model.model_copy(update={"plant": plant})
    result = find_gap([filtered(recording, 0.3)], wrong, refit_base=True, design=False)
    assert set(result.effects) == {"inertia_error", "coulomb_friction"}, result.statement
    assert result.recording["current_filter_s"]["value"] == pytest.approx(0.3, rel=0.02)
    assert result.base["inertia"].value == pytest.approx(inertia, rel=0.02)
    assert result.base["coulomb"].value == pytest.approx(coulomb, rel=0.02)


def test_what_was_asked_for_and_is_in_the_record_already_is_said(hidden: Callable[..., Any]) -> None:
    recording, model = hidden([], 29, 8.0)
    asked = ["current_saturation", "amplifier_lag"]
    result = find_gap([filtered(recording, 0.02)], model, candidates=asked, design=False)
    for slug in asked:
        assert any(warning.startswith(f"{slug} cannot be considered: the record") for warning in result.warnings)


def test_a_filter_is_undone_in_each_recording_up_to_its_gaps(hidden: Callable[..., Any]) -> None:
    recording, _ = hidden([], 29, 3.0)
    kept = np.ones(recording.rows, dtype=bool)
    kept[1000:1200] = False
    record = filtered(recording, 0.02)
    gappy = replace(
        record,
        time_s=record.time_s[kept],
        position=record.position[kept],
        current=record.current[kept],
        current_measured=None,
    )
    commands = series_of([gappy, record]).commands(0.02)
    actual = np.concatenate([recording.current[kept], recording.current])
    last = [999, gappy.rows - 1, gappy.rows + record.rows - 1]  # nothing follows that tells
    assert np.delete(commands, last) == pytest.approx(np.delete(actual, last), abs=1e-9)
    assert commands[last] == pytest.approx(np.concatenate([gappy.current, record.current])[last])


@pytest.mark.parametrize("effect", [None, {"name": "constant_bias", "tau_0": 6e-4}])
def test_a_late_record_is_told_and_no_effect_is_named_for_it(hidden: Callable[..., Any], effect: Any) -> None:
    recording, model = hidden([effect] if effect else [], 29, 8.0)
    result = find_gap([delayed(recording)], model, design=False)
    assert result.effects == (("constant_bias",) if effect else ()), result.statement
    late = result.recording["current_late_s"]
    assert late["value"] == pytest.approx(ROWS * recording.period_s, rel=0.03)
    assert late["ci95"][0] < late["value"] < late["ci95"][1]
    assert any("recorded 2 ms late" in warning for warning in result.warnings)
    assert "its current 2 ms late" in timing(result.to_json())


def test_a_record_in_time_says_nothing_of_it(hidden: Callable[..., Any]) -> None:
    recording, model = hidden([], 29, 8.0)
    result = find_gap([recording], model, design=False)
    assert "current_late_s" not in result.recording


def test_a_late_device_is_no_late_record(hidden: Callable[..., Any]) -> None:
    recording, model = hidden([{"name": "transport_delay", "t_d": 2e-3}], 29, 8.0)
    result = find_gap([recording], model, design=False)
    assert result.effects == ("transport_delay",), result.statement
    assert "current_late_s" not in result.recording


def test_a_late_record_stays_near_where_it_was_found() -> None:
    """Without the laws beside which it was found a robot's joint had it at the end of its range, and nothing was named."""
    for slug in ("transport_delay", "amplifier_lag"):
        law = late_record.starts(slug, 1e-3)[2]
        item = late_record.record_term(law)
        (own,) = item.coordinates
        assert item.slug == late_record.SLUG
        assert (own.centre, own.prior) == (law.start[0], law.coordinates[0].scale)
        assert item.start == law.start


def test_a_late_record_shows_no_timing_of_its_commands() -> None:
    (law, *_) = late_record.starts("transport_delay", 1e-3)
    slugs = ["stribeck", "dropped_samples", "amplifier_lag", "transport_delay", "current_saturation"]
    timing = {slug for slug in slugs if CATALOGUE[slug].acts_on == "timing"}
    assert timing >= {"dropped_samples", "transport_delay"}
    assert late_record.identifiable(slugs, law) == [slug for slug in slugs if slug not in timing]
