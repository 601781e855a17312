"""Bring measured data from elsewhere into a native run file, as a map of its columns says.

Time stamps are stored as they are, jitter included: floating-point stamps to the last bit in seconds, whole-number stamps
from the first one on, before they lose digits. Positions become counts of the stated resolution.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapticd.config import Config, load_config
from hapticd.config.units import ANGLE_UNITS, CURRENT_UNITS, UNITS, spelled
from hapticd.figures.files import refuse_existing
from hapticd.record._importing_sources import Source, read_source, refuse_missing
from hapticd.record._stamps import read_stamps
from hapticd.record.errors import RunFileError
from hapticd.record.files import written
from hapticd.record.importing_map import COUNT, ImportMap, Signal
from hapticd.record.metadata import run_metadata
from hapticd.record.run import median_period, time_warnings
from hapticd.record.schema import FLAG_RUNNING, Rows, empty_rows
from hapticd.record.writer import RunWriter

FloatArray = NDArray[np.float64]

_ON_GRID = 0.02
"""A position this close to a multiple of the resolution, in resolutions, is that multiple with rounding."""


@dataclass(frozen=True)
class Imported:
    """What an import wrote.

    Attributes:
        path: the run file. rows: its rows. duration_s: from the first to the last. rate_hz: of the median period.
        resolution: one count in rad or m. position: smallest and largest, rad or m, from the file's zero.
        command: smallest and largest current in A, or force in N m or N where the file holds forces.
        is_linear, is_force: which units these are.
        warnings: what a reader should know before trusting it.
        hints: keys of a config that something beside the data knows, as a URDF does; SI.
    """

    path: Path
    rows: int
    duration_s: float
    rate_hz: float
    resolution: float
    position: tuple[float, float]
    command: tuple[float, float]
    is_linear: bool
    is_force: bool
    warnings: tuple[str, ...]
    hints: Mapping[str, float] = field(default_factory=dict)


def import_run(source: str | Path, mapping: ImportMap, out: str | Path, *, force: bool = False) -> Imported:
    """Read a foreign file and write it as a native run; the file appears whole under its name or not at all.

    Args:
        source: text (.csv, .txt, .tsv, .dat, .asc), .mat, .npy, .npz or .parquet.
        mapping: what its columns are.
        out: the run file to write.
        force: replace a file that exists.

    Raises:
        RunFileError: the source cannot be read, lacks a column, or holds what no run can hold; or the run cannot be
            written, and nothing is left behind.
        FileExistsError: ``out`` exists, or is the source.
        ConfigError: the map's ``model`` is not valid.
    """
    path, target = Path(source), Path(out)
    refuse_existing(target, force=force, source=path)
    model = load_config(mapping.model) if mapping.model is not None else None
    if model is not None and model.is_linear != mapping.is_linear:
        kind = "linear" if model.is_linear else "rotary"
        raise RunFileError(f"{path}: device = {mapping.device}, but model {mapping.model} describes a {kind} one")
    columns = read_source(path, mapping)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        # What leaves floating point is found, and named by its row.
        counts_per_unit = _counts_per_unit(path, mapping, model)
        rows, origin, notes = _rows(columns, mapping, model, counts_per_unit)
    metadata = _metadata(path, mapping, model, counts_per_unit, origin)
    with written(target) as part, RunWriter(part, metadata) as writer:
        writer.write(rows)
    resolution = (1.0 if mapping.is_linear else 2.0 * np.pi) / counts_per_unit
    done = imported(target, rows, resolution, is_linear=mapping.is_linear, is_force=mapping.force is not None)
    return replace(done, warnings=(*notes, *done.warnings))


def imported(
    path: Path, columns: Rows | Mapping[str, Any], resolution: float, *, is_linear: bool, is_force: bool
) -> Imported:
    """What is said of the rows that an import wrote."""
    time_s = columns["time_s"]
    period = median_period(time_s)
    return Imported(
        path=path,
        rows=time_s.size,
        duration_s=float(time_s[-1]) - float(time_s[0]),
        rate_hz=1.0 / period if period > 0.0 else float("nan"),
        resolution=resolution,
        position=_ends(columns["encoder_counts"] * resolution),
        command=_ends(columns["force_command" if is_force else "current_command_A"]),
        is_linear=is_linear,
        is_force=is_force,
        warnings=tuple(time_warnings(time_s, columns["encoder_counts"])),
    )


def _ends(values: FloatArray) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _counts_per_unit(path: Path, mapping: ImportMap, model: Config | None) -> float:
    """Counts per revolution or metre in which positions are stored."""
    size = 1.0 if mapping.is_linear else 2.0 * np.pi
    encoder = mapping.encoder.counts_per_metre if mapping.is_linear else mapping.encoder.counts_per_rev
    if encoder is None and model is not None:
        encoder = model.encoder.counts_per_metre if mapping.is_linear else model.encoder.counts_per_rev
    position = mapping.position
    in_counts = position.unit == COUNT
    if in_counts and encoder is None:
        key = "encoder.counts_per_metre" if mapping.is_linear else "encoder.counts_per_rev"
        raise RunFileError(f"{path}: position.unit = count needs {key}")
    if position.resolution is not None:
        unit = 1.0 if in_counts else mapping.position_units[_unit(mapping)]
        counts = np.float64(encoder if in_counts and encoder else size) / (position.resolution * unit)
        if not 0.0 < counts < np.inf:
            raise RunFileError(
                f"{path}: position.resolution = {position.resolution:g}: gives {counts:g} counts a revolution or metre"
            )
        return float(counts)
    if encoder is None:
        raise RunFileError(
            f"{path}: position.resolution is missing: the width of one step of the position (or give encoder)"
        )
    return encoder


def _unit(mapping: ImportMap) -> str:
    return mapping.position.unit or ("m" if mapping.is_linear else "rad")


def _rows(
    source: Source, mapping: ImportMap, model: Config | None, counts_per_unit: float
) -> tuple[Rows, float, list[str]]:
    notes = [*source.notes, *_other_units(source, mapping)]
    position = _finite(source, mapping.position, "position")
    notes += _about_wraps(position, mapping)
    if mapping.position.wrap is not None:
        position = np.unwrap(position, period=mapping.position.wrap)
    time_s, origin, of_time = _time(source, mapping, position.size)
    notes += of_time
    counts = _counts(source.path, position, mapping, model, counts_per_unit)
    command_key = "current" if mapping.current is not None else "force"
    command = mapping.current or mapping.force
    assert command is not None  # the map was checked
    units = CURRENT_UNITS if command_key == "current" else mapping.force_units
    driven = _finite(source, command, command_key) * units[command.unit or next(iter(units))]
    measured = np.full(position.size, np.nan)
    if mapping.current_measured is not None:
        signal = mapping.current_measured
        measured = _values(source, signal, "current_measured") * CURRENT_UNITS[signal.unit or "A"]
    lengths = {"time": time_s.size, "position": counts.size, command_key: driven.size}
    if mapping.current_measured is not None:
        lengths["current_measured"] = measured.size
    if len(set(lengths.values())) != 1:
        listed = ", ".join(f"{key} {length}" for key, length in lengths.items())
        raise RunFileError(f"{source.path}: the columns have different lengths: {listed}")
    inside = _span(source.path, time_s, mapping)
    time_s, counts, driven, measured = time_s[inside], counts[inside], driven[inside], measured[inside]
    if mapping.every > 1:
        kept = time_s.size // mapping.every * mapping.every
        if kept == 0:
            raise RunFileError(f"{source.path}: every = {mapping.every}: the file has only {time_s.size} samples")
        time_s, counts = time_s[: kept : mapping.every], counts[: kept : mapping.every]
        driven, measured = (v[:kept].reshape(-1, mapping.every).mean(axis=1) for v in (driven, measured))
    rows = empty_rows(time_s.size)
    rows["tick"] = np.arange(time_s.size)
    rows["time_s"] = time_s
    rows["encoder_counts"] = rows["ticks"] = counts
    constant = _torque_constant(mapping, model)
    if command_key == "force":
        rows["force_command"], rows["current_command_A"] = driven, driven / constant
    else:
        rows["current_command_A"], rows["force_command"] = driven, driven * constant
    rows["current_measured_A"] = measured
    rows["flags"] = FLAG_RUNNING
    return rows, origin, notes


def _other_units(source: Source, mapping: ImportMap) -> Iterator[str]:
    """Where the file's own row of units says something else than the map."""
    for key, default in (
        ("time", "s"), ("position", _unit(mapping)), ("current", "A"), ("current_measured", "A"),
        ("force", next(iter(mapping.force_units))),
    ):  # fmt: skip
        part = getattr(mapping, key)
        said = source.unit(part.column) if part is not None and part.column is not None else None
        if said is not None and spelled(said) in UNITS and spelled(said) != spelled(part.unit or default):
            yield f"{key}.unit is {part.unit or default}, but the file says {said!r} of column {part.column}"


def _about_wraps(position: FloatArray, mapping: ImportMap) -> Iterator[str]:
    """A wrap that changes nothing, or a jump that looks like one that is missing in the map."""
    wrap, unit, factor = mapping.position.wrap, _unit(mapping), abs(mapping.position.factor)
    steps = np.abs(np.diff(position))
    row = int(np.argmax(steps)) if steps.size else 0
    jump = float(steps[row]) if steps.size else 0.0
    if wrap is not None and jump > 0.5 * wrap:
        return
    turn = 2.0 * np.pi / ANGLE_UNITS[unit] if unit in ANGLE_UNITS else mapping.encoder.counts_per_rev or 0.0
    usual = [(wrap or 0.0) * factor, turn, *(2.0**bits for bits in (8, 10, 12, 14, 16) if unit == COUNT)]
    near = next((size for size in usual if size != wrap and 0.9 * size < jump <= 1.01 * size), None)
    if wrap is not None:
        remedy = f"; position.wrap: {near:.6g} would" if near else ""
        if near and factor != 1.0 and near == wrap * factor:
            remedy += ", for it is taken after position.factor"
        yield (
            f"position.wrap = {wrap:g} {unit} never acts: from sample to sample the position moves by no more than "
            f"{jump:.6g} {unit}{remedy}"
        )
    elif near and np.ptp(position) <= 1.01 * near and jump > 10.0 * np.quantile(steps, 0.9):
        yield (
            f"position jumps by {jump:.6g} {unit} at row {row + 1}: does it start again there? position.wrap: {near:.6g} "
            "carries it on"
        )


def _torque_constant(mapping: ImportMap, model: Config | None) -> float:
    if mapping.torque_constant is not None:
        return mapping.torque_constant
    return model.amplifier.torque_constant if model is not None else float("nan")


def _time(source: Source, mapping: ImportMap, samples: int) -> tuple[FloatArray, float, list[str]]:
    """Stamps in s, the stamp that was taken off them, in the file's unit, and what is to be known of them."""
    if mapping.time.column is None:
        assert mapping.time.rate_hz is not None  # the map was checked
        time_s = np.arange(samples) / mapping.time.rate_hz
        refuse_missing(f"{source.path}: time.rate_hz = {mapping.time.rate_hz:g}", time_s)
        return time_s, 0.0, []
    return read_stamps(source, mapping.time, mapping.time.column)


def _counts(
    path: Path, position: FloatArray, mapping: ImportMap, model: Config | None, counts_per_unit: float
) -> NDArray[np.int64]:
    if mapping.position.unit == COUNT:
        steps = position / (mapping.position.resolution or 1.0)
    else:
        size = 1.0 if mapping.is_linear else 2.0 * np.pi
        steps = position * mapping.position_units[_unit(mapping)] * (counts_per_unit / size)
    if steps.size and np.abs(steps).max() >= 2.0**53:
        row = int(np.argmax(np.abs(steps) >= 2.0**53))
        raise RunFileError(f"{path}: position, row {row}: {steps[row]:.3g} counts are more than a position can have")
    nearest = np.rint(steps)
    # Decoders that give multiples of the resolution give the cell's edge; anything finer is floored as a counter does.
    on_grid = bool(np.all(np.abs(steps - nearest) < _ON_GRID))
    return np.asarray(nearest if on_grid else np.floor(steps), dtype=np.int64)


def _span(path: Path, time_s: FloatArray, mapping: ImportMap) -> slice:
    if time_s.size < 2:
        raise RunFileError(f"{path} has {time_s.size} sample(s); a run needs at least 2")
    after = time_s - time_s[0]
    late_enough = np.flatnonzero(after >= (-np.inf if mapping.from_s is None else mapping.from_s))
    early_enough = np.flatnonzero(after <= (np.inf if mapping.until_s is None else mapping.until_s))
    if not late_enough.size or not early_enough.size or early_enough[-1] <= late_enough[0]:
        raise RunFileError(f"{path}: from_s and until_s leave fewer than 2 samples of {after[-1]:g} s")
    return slice(int(late_enough[0]), int(early_enough[-1]) + 1)


def _values(source: Source, signal: Signal, key: str) -> FloatArray:
    raw = np.asarray(source.numbers(signal.column, f"{key}.column"), dtype=np.float64)
    return np.asarray((raw * signal.factor + signal.offset) * signal.sign)


def _finite(source: Source, signal: Signal, key: str) -> FloatArray:
    values = _values(source, signal, key)
    refuse_missing(f"{source.path}: {key}", values)
    return values


def _metadata(
    path: Path, mapping: ImportMap, model: Config | None, counts_per_unit: float, origin: float
) -> dict[str, Any]:
    key = "counts_per_metre" if mapping.is_linear else "counts_per_rev"
    encoder = {key: counts_per_unit}
    imported = {
        "file": path.name,
        "map": mapping.model_dump(mode="json", exclude_defaults=True),
        "command": "current" if mapping.current is not None else "force",
        "time_origin": origin,
    }
    constant = _torque_constant(mapping, model)
    known: dict[str, Any] = {"encoder": encoder}
    if np.isfinite(constant):
        known["amplifier"] = {"torque_constant": constant}
    config: dict[str, Any] = {}
    if model is not None:
        # What the map says of the recorded device goes before what its model says.
        config = model.model_dump(mode="json")
        config["encoder"] |= {"counts_per_rev": None, "counts_per_metre": None, "decimation": 1, **encoder}
        config["amplifier"] |= known["amplifier"]
    kept = None if model is not None else known
    return run_metadata(config, model=kept, linear=mapping.is_linear, kind="import", imported=imported)
