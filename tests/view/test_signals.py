"""Signals of a run: against motions that are known in closed form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapticd.config import load_config
from hapticd.record import Run, RunFileError
from hapticd.view import difference, first_seconds, run_figure, signals

RAW = 2.0 * np.pi / 8192


def oscillation(rows: int = 4000, hz: float = 37.3, **columns: Any) -> Run:
    """A sine of 500 counts about the origin at 1 kHz, the spring rendered from row 100 on."""
    time_s = np.arange(rows) / 1000.0
    values = {
        "time_s": time_s,
        "encoder_counts": np.floor(700 + 500.0 * np.sin(2 * np.pi * hz * time_s)).astype(np.int64),
        "current_command_A": np.cos(2 * np.pi * hz * time_s),
        "wake_late_ns": np.arange(rows, dtype=np.int64),
        "exec_ns": np.full(rows, 5000, dtype=np.int64),
        "flags": np.where(np.arange(rows) < 100, 0, 1),
        **columns,
    }
    metadata = {"config": load_config(None).model_dump(mode="json"), "origin_counts": 700}
    return Run(Path("run.arrow"), values, metadata)


def test_position_and_velocity_are_those_of_the_motion() -> None:
    found = signals(oscillation())
    shown = slice(10, -10)
    true = 500 * RAW * np.sin(2 * np.pi * 37.3 * (found.time_s + 0.1))
    slope = 2 * np.pi * 37.3 * 500 * RAW * np.cos(2 * np.pi * 37.3 * (found.time_s + 0.1))
    assert found.position_unit == "rad"
    assert np.max(np.abs(found.position - true)) <= RAW / 2 * (1 + 1e-9)
    assert np.max(np.abs(found.velocity - slope)[shown]) < 0.01 * np.max(np.abs(slope))


def test_time_begins_where_the_spring_was_rendered() -> None:
    found = signals(oscillation())
    assert found.time_s[100] == 0.0
    assert signals(oscillation(flags=np.zeros(4000, dtype=np.int64))).time_s[0] == 0.0


def test_the_spectrum_has_its_peak_and_its_power_where_the_motion_has() -> None:
    found = signals(oscillation(rows=8000))
    spectrum = found.spectrum(found.position)
    assert spectrum is not None
    assert spectrum.peak_hz == pytest.approx(37.3, abs=0.1)
    power = float(np.sum(spectrum.density**2) * (spectrum.hz[1] - spectrum.hz[0]))
    assert np.sqrt(power) == pytest.approx(500 * RAW / np.sqrt(2), rel=0.01)


def test_lateness_in_the_document() -> None:
    late = signals(oscillation(flags=np.where(np.arange(4000) % 1000 == 500, 1 | 4, 1))).document["lateness"]
    assert late == {
        "missed": 4,
        "p50_us": pytest.approx(1.9995),
        "p99_us": pytest.approx(3.95901),
        "max_us": pytest.approx(3.999),
    }
    assert signals(oscillation(wake_late_ns=np.zeros(4000, dtype=np.int64))).document["lateness"] is None


def test_the_difference_is_the_second_less_the_first() -> None:
    first = oscillation()
    moved = replace(first, columns={**first.columns, "encoder_counts": first.columns["encoder_counts"] + 3})
    found = difference(signals(first), signals(moved))
    np.testing.assert_allclose(found.position, 3 * RAW, rtol=1e-9)
    assert found.document["command"]["max"] == 0.0
    assert found.document["position"] == {
        "rms": pytest.approx(3 * RAW),
        "max": pytest.approx(3 * RAW),
        "unit": signals(first).position_unit,
    }


def test_the_difference_is_taken_at_the_times_of_both() -> None:
    whole, half = signals(oscillation()), signals(first_seconds(oscillation(), 1.0))
    for one, other in ((whole, half), (half, whole)):
        assert difference(one, other).time_s[-1] == half.time_s[-1]
    later = replace(half, time_s=half.time_s + 10.0)
    with pytest.raises(RunFileError, match="have no time in common"):
        difference(whole, later)


def test_no_difference_between_units() -> None:
    foreign = replace(oscillation(), metadata={})
    assert signals(foreign).position_unit == "count"
    with pytest.raises(RunFileError, match=r"positions in count, .* in rad"):
        difference(signals(oscillation()), signals(foreign))


def test_first_seconds_are_counted_from_the_rendering() -> None:
    cut = signals(first_seconds(oscillation(), 0.25))
    assert cut.time_s[-1] == pytest.approx(0.249)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"time_s": np.zeros(1)}, "at least 2 are needed"),
        ({"time_s": np.zeros(4000)}, "do not increase"),
    ],
)
def test_what_cannot_be_drawn_says_why(columns: dict[str, Any], said: str) -> None:
    with pytest.raises(RunFileError, match=said):
        signals(oscillation(**columns))


def test_a_figure_has_the_panels_asked_for() -> None:
    found = signals(oscillation())
    titles = [axis.get_title(loc="left") for axis in run_figure(found).axes]
    assert len([title for title in titles if title]) == 5
    assert len(run_figure(found, only=["phase"]).axes) == 1
    with pytest.raises(ValueError, match="no panel 'phases'"):
        run_figure(found, only=["phases"])


def legend_texts(legend: Any) -> list[str]:
    return [text.get_text() for text in legend.get_texts()]


def test_the_legend_of_a_difference_shows_what_is_drawn() -> None:
    first, second = signals(oscillation()), signals(oscillation(hz=37.8))
    figure = run_figure(first, second, only=["difference"])
    assert figure.legends == []
    panel, commands = figure.axes
    legend = panel.get_legend()
    assert legend_texts(legend) == ["position", "command", "± one coarse tick"]
    line, dots, _ = legend.legend_handles
    assert line.get_color() == panel.lines[0].get_color()
    assert (dots.get_color(), dots.get_marker()) == (commands.lines[0].get_color(), ".")


def test_runs_are_in_the_legend_where_they_are_drawn_in_their_colours() -> None:
    first, other = signals(oscillation()), signals(oscillation(hz=37.8))
    second = replace(other, run=replace(other.run, path=Path("other.arrow")))
    (legend,) = run_figure(first, second).legends
    assert legend_texts(legend) == ["run.arrow", "other.arrow"]
    assert run_figure(first, second, only=["energy"]).legends == []
    virtual = replace(first, late_s=None, exec_s=None)
    (legend,) = run_figure(virtual, second, only=["lateness"]).legends
    assert legend_texts(legend) == ["other.arrow"]
    assert run_figure(virtual, replace(second, late_s=None, exec_s=None), only=["lateness"]).legends == []


def test_long_names_leave_title_and_legend_readable() -> None:
    found = signals(oscillation())
    both = [
        replace(found, run=replace(found.run, path=Path(f"run-20261127T154344.941Z-excite-{kind}.arrow")))
        for kind in ("steps", "chirp")
    ]
    figure = run_figure(*both, only=["trace", "phase"])
    (legend,) = figure.legends
    title = figure.get_suptitle()
    (drawn,) = [text for text in figure.texts if text.get_text() == title]
    boxes = [drawn.get_window_extent(), *(axis.get_tightbbox() for axis in figure.axes)]
    assert not any(legend.get_window_extent().overlaps(box) for box in boxes)
