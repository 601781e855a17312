"""Reads one recorded run, of any file format, as arrays in SI units.

Positions are centres of quantisation cells: the encoder floors, so counts·Δ ≤ θ < (counts + 1)·Δ. Times are the sampling
instants: due time plus lateness, or an estimate from stamps on a grid (`hapticd.record.stamp_grid`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.config import Config, Encoder, parse_config
from hapticd.gap.checks import check_recording, check_samples
from hapticd.gap.errors import RecordingError
from hapticd.gap.own_clock import at_the_samples, own_clock
from hapticd.gap.recording import Recording
from hapticd.record import FLAG_MISSED_EXCHANGE, Run, read_run
from hapticd.record.stamp_grid import spread

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from hapticd.gap.arrays import Floats


def load_recording(path: str | Path, model: Config) -> Recording:
    """Read a run, native or ``.csv`` or ``.parquet``.

    Args:
        path: run file with ``time_s``; ``encoder_counts`` or ``position``; ``current_command_A`` or ``force``.
        model: gives the encoder's resolution to a file without a config, and the torque constant to one with forces.

    Raises:
        RunFileError: the file cannot be read.
        ConfigError: the config inside a native run is not valid.
        RecordingError: the samples are unusable; see `hapticd.gap.checks`.
    """
    return recording_of(read_run(path), model)


def recording_of(run: Run, model: Config) -> Recording:
    """The recording of a run that is already read; arguments and errors as in `load_recording`."""
    recording = unchecked(run, model)
    return replace(recording, warnings=(*recording.warnings, *check_recording(recording, model)))


def unchecked(run: Run, model: Config) -> Recording:
    """The same without the comparison with the model's plant.

    Positions have the sign of the model's `encoder.invert`. Counts of a file without a config are not inverted yet;
    positions, and imported runs, keep their sign.
    """
    stored = run.metadata.get("config")
    config = parse_config(stored, f"config of {run.path.name}") if stored else None
    is_linear = bool(run.metadata.get("linear", model.is_linear if config is None else config.is_linear))
    if is_linear != model.is_linear:
        kinds = ("a linear device (m, N)", "a rotary device (rad, N m)")
        raise RecordingError(f"{run.path}: a run of {kinds[not is_linear]}, but the model is {kinds[is_linear]}")
    columns = run.columns
    time_s, step_s = _instants(columns)
    position, resolution = _positions(columns, _resolution(run, config or model))
    warnings = run.warnings
    if step_s:
        period_s = float(np.median(np.diff(time_s)))
        grid = (
            f"{run.path.name}: the stamps lie on a grid of {1e3 * step_s:.3g} ms, {step_s / period_s:.2g} of a period"
        )
        warnings = (*warnings, f"{grid}: samples are spread evenly; how late one was is not known")
    if _is_turned(run, config, model):
        position = -position
        says, known = ("true", "false") if model.encoder.invert else ("false", "true")
        recorded = f"it was recorded with {known}" if config else "the file has no config"
        turned = f"{run.path.name}: encoder.invert of the model is {says}, and {recorded}: positions are turned round"
        warnings = (*warnings, turned)
    current = _current(run, model)
    check_samples(str(run.path), time_s, position, current)
    measured, clock = _measured(columns), own_clock(time_s, position, resolution)
    if clock:
        warnings = (*warnings, f"{run.path.name}: {clock.described(float(np.median(np.diff(time_s))))}")
        rows, time_s, current = at_the_samples(time_s, current, clock)
        position, measured = position[rows], measured if measured is None else measured[rows]
    return Recording(
        name=run.path.name,
        time_s=time_s - time_s[:1],
        position=position,
        resolution=resolution,
        current=current,
        current_measured=measured,
        period_s=float(np.median(np.diff(time_s))),
        is_linear=is_linear,
        warnings=warnings,
    )


def _is_turned(run: Run, config: Config | None, model: Config) -> bool:
    """Whether the encoder counts with the opposite sign of the model's; never for an import, whose map has set the sign."""
    if "imported" in run.metadata or (config is None and "encoder_counts" not in run.columns):
        return False
    return model.encoder.invert != (config is not None and config.encoder.invert)


def _instants(columns: dict[str, NDArray[Any]]) -> tuple[Floats, float]:
    """The sampling instants, and the grid on which their stamps lie [s]; 0 for none."""
    due = np.asarray(columns["time_s"], dtype=np.float64)
    late = columns.get("wake_late_ns")
    if late is not None and np.any(late):  # an imported run has the column, and zeros in it
        return due + 1e-9 * np.asarray(late, dtype=np.float64), 0.0
    return spread(due) if due.size > 1 and np.all(np.isfinite(due)) else (due, 0.0)


def _positions(columns: dict[str, NDArray[Any]], resolution: float) -> tuple[Floats, float]:
    if "encoder_counts" not in columns:
        position = np.asarray(columns["position"], dtype=np.float64)
        return position, step_of(position, resolution)
    counts = np.asarray(columns["encoder_counts"], dtype=np.float64)
    position = (counts + 0.5) * resolution
    if "flags" in columns:
        # A failed exchange repeats the last counts: it is no measurement.
        known = columns["flags"] & FLAG_MISSED_EXCHANGE == 0
        if known.any() and not known.all():
            row = np.arange(counts.size)
            position = np.interp(row, row[known], position[known])
    return position, resolution


def step_of(position: Floats, nominal: float) -> float:
    """Width of the quantisation cells of positions: the nominal one if they lie on its grid.

    Otherwise the smallest step of which all steps are whole multiples (to 2 %); 0 if there is none.
    """
    steps = np.unique(np.abs(np.diff(position)))
    steps = steps[steps > 1e-9 * max(float(np.abs(position).max(initial=0.0)), 1e-300)]
    for step in (nominal, float(steps[0]) if steps.size else 0.0):
        if step > 0.0 and steps.size and np.all(np.abs(steps / step - np.rint(steps / step)) < 0.02):
            return step
    return 0.0


def _resolution(run: Run, config: Config) -> float:
    """One count in rad or m, from the config; for an imported run without a config, from its model."""
    encoder = (run.metadata.get("model") or {}).get("encoder") or {}
    return Encoder(**encoder).raw_resolution if encoder else config.raw_resolution


def _current(run: Run, model: Config) -> Floats:
    imported = run.metadata.get("imported") or {}
    if "force" in run.columns and "current_command_A" not in run.columns:
        force = run.columns["force"]
    elif imported.get("command") == "force":
        # The force was recorded; the current column was computed from it with the torque constant of the import map.
        force = run.columns["force_command"]
    else:
        return np.asarray(run.columns["current_command_A"], dtype=np.float64)
    return np.asarray(force, dtype=np.float64) / model.amplifier.torque_constant


def _measured(columns: dict[str, NDArray[Any]]) -> Floats | None:
    measured = columns.get("current_measured_A")
    if measured is None or not np.all(np.isfinite(measured)):
        return None
    return np.asarray(measured, dtype=np.float64)
