"""Signals of a run: motion in SI units, estimated velocity, spectra and lateness.

Position is the middle of the encoder's cell, (counts − origin + ½) · resolution, from the spring's origin if the run has
it. Velocity is its derivative by a Savitzky-Golay filter (a quartic over seven samples), which has no lag.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.signal import savgol_filter, welch

from hapticd.config import Config, parse_config
from hapticd.record import RunFileError
from hapticd.record.schema import FLAG_FAULT, FLAG_MISSED_PERIOD, FLAG_RUNNING
from hapticd.record.where import note_text
from hapticd.stability.run_energy import run_energy

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.record import Run
    from hapticd.stability.run_energy import RunEnergy

    FloatArray = NDArray[np.float64]

_LONGEST_NAME = 32
SLOPE_SAMPLES = 7
_SEGMENT = 4096
"""Most samples of a segment; the spectrum of a longer run is averaged over half-overlapping segments."""

_PADDING = 4
"""Zero padding, in lengths of a segment: it refines the frequency of the peak in a short run."""


@dataclass(frozen=True)
class Spectrum:
    """One-sided amplitude spectral density (Welch, Hann window, mean removed).

    Attributes:
        hz: (m,) above 0. density: (m,) in the signal's unit per √Hz. peak_hz: frequency of its maximum.
    """

    hz: FloatArray
    density: FloatArray

    @property
    def peak_hz(self) -> float:
        """Frequency of the largest density, Hz."""
        return float(self.hz[np.argmax(self.density)])


@dataclass(frozen=True)
class Signals:
    """A run as signals; n rows.

    Attributes:
        run: the run. config: its own config; None if it has no valid one.
        time_s: (n,) from the first row with the spring rendered, else from the first row.
        position: (n,) in ``position_unit``, from the spring's origin. velocity: (n,) estimated, per s.
        current: (n,) commanded, A; or the force if the run has no current. current_unit: its unit.
        running: (n,) whether the spring was rendered.
        tick: one coarse tick in ``position_unit``; None if unknown.
        position_unit: ``rad``, ``m``, or ``count`` if the resolution is unknown.
        late_s, exec_s: (n,) lateness of the wake-up and duration of the tick; None if not recorded, or in virtual time.
        missed: number of ticks after skipped periods.
        period_s: median period. events: (time, name) of notes, markers and changes.
        energy: ledger of the last start; None if there is none, with the reason in `why_no_energy`.
    """

    run: Run
    config: Config | None
    time_s: FloatArray
    position: FloatArray
    velocity: FloatArray
    current: FloatArray
    current_unit: str
    running: NDArray[np.bool_]
    tick: float | None
    position_unit: str
    late_s: FloatArray | None
    exec_s: FloatArray | None
    missed: int
    period_s: float
    events: tuple[tuple[float, str], ...]
    energy: RunEnergy | None
    why_no_energy: str | None
    notes: tuple[str, ...] = field(default=())

    def spectrum(self, values: FloatArray) -> Spectrum | None:
        """Spectrum of a signal of this run, (n,), over the rows with the spring rendered; None below 16 rows."""
        part = values[self.running] if self.running.any() else values
        if part.size < 16 or not np.all(np.isfinite(part)):
            return None
        segment = min(_SEGMENT, part.size)
        hz, power = welch(part, fs=1.0 / self.period_s, nperseg=segment, nfft=_PADDING * segment, detrend="constant")
        return Spectrum(hz[1:], np.sqrt(power[1:]))

    @property
    def document(self) -> dict[str, Any]:
        """The document of ``hapticd plot --json``."""
        spectrum = self.spectrum(self.position)
        energy = self.energy.report if self.energy is not None else None
        return {
            "run": self.run.path,
            "rows": self.run.rows,
            "duration_s": float(np.ptp(self.time_s)),
            "rate_hz": 1.0 / self.period_s,
            "position": _range(self.position, self.position_unit),
            "velocity": _range(self.velocity, f"{self.position_unit}/s"),
            "command": _range(self.current, self.current_unit),
            "peak_hz": spectrum.peak_hz if spectrum is not None and spectrum.density.any() else None,
            "energy": energy and {key: energy[key] for key in ("stored_J", "dissipated_J", "generated_J")},
            "lateness": None if self.late_s is None else {"missed": self.missed, **_percentiles(self.late_s)},
        }


def first_seconds(run: Run, duration_s: float) -> Run:
    """The first `duration_s` seconds of a run, from the first row with the spring rendered (else from the first row)."""
    time_s = run.columns["time_s"]
    flags = run.columns.get("flags")
    rendered = np.flatnonzero(flags & FLAG_RUNNING) if flags is not None else np.zeros(0, dtype=np.intp)
    first = int(rendered[0]) if rendered.size else 0
    last = first + int(np.searchsorted(time_s[first:], time_s[first] + duration_s)) if time_s.size else 0
    return replace(run, columns={name: values[:last] for name, values in run.columns.items()})


def signals(run: Run, config: Config | None = None) -> Signals:
    """A run as signals.

    Args:
        run: from `hapticd.record.read_run`.
        config: for a run without one: its encoder for the unit, its model for the energy.

    Raises:
            RunFileError: fewer than two rows, or time stamps that do not increase.
            ConfigError: the run's own config is invalid.
    """
    time_s = np.asarray(run.columns["time_s"], dtype=np.float64)
    if time_s.size < 2:
        raise RunFileError(f"{run.path} has {time_s.size} row(s); at least 2 are needed")
    period = float(np.median(np.diff(time_s)))
    if not period > 0.0:
        raise RunFileError(f"{run.path}: its time stamps do not increase")
    stored = run.metadata.get("config")
    config = parse_config(stored, f"config of {run.path.name}") if stored else config
    columns = run.columns
    flags = np.asarray(columns.get("flags", np.full(time_s.size, FLAG_RUNNING)), dtype=np.int64)
    running = (flags & FLAG_RUNNING) != 0
    start = time_s[int(np.argmax(running))] if running.any() else time_s[0]
    position, unit = _position(run, config)
    velocity = _slope(position, period)
    command, command_unit = _command(run)
    energy, why = _energy(run, config)
    events = _events(run, time_s - start)
    if (flags & FLAG_FAULT).any():
        events.append((float((time_s - start)[int(np.argmax((flags & FLAG_FAULT) != 0))]), "fault"))
    late = columns.get("wake_late_ns")
    measured = late is not None and bool(np.any(late))
    return Signals(
        run=run,
        config=config,
        time_s=time_s - start,
        position=position,
        velocity=velocity,
        current=command,
        current_unit=command_unit,
        running=running,
        tick=config.resolution if config is not None and unit != "count" else None,
        position_unit=unit,
        late_s=np.asarray(late, dtype=np.float64) * 1e-9 if measured and late is not None else None,
        exec_s=np.asarray(columns["exec_ns"], dtype=np.float64) * 1e-9 if measured and "exec_ns" in columns else None,
        missed=int(np.count_nonzero(flags & FLAG_MISSED_PERIOD)),
        period_s=period,
        events=tuple(events),
        energy=energy,
        why_no_energy=why,
        notes=run.warnings,
    )


def _position(run: Run, config: Config | None) -> tuple[FloatArray, str]:
    """Position from the spring's origin, and its unit."""
    columns = run.columns
    if "encoder_counts" not in columns:
        linear = config.is_linear if config is not None else run.units.get("position") == "m"
        return np.asarray(columns["position"], dtype=np.float64), "m" if linear else "rad"
    counts = np.asarray(columns["encoder_counts"], dtype=np.float64)
    if config is None:
        return counts - counts[0], "count"
    origin = run.metadata.get("origin_counts")
    counts = counts - float(config.origin_counts if origin is None else origin) + 0.5
    return counts * config.raw_resolution, "m" if config.is_linear else "rad"


def _command(run: Run) -> tuple[FloatArray, str]:
    if "current_command_A" in run.columns:
        return np.asarray(run.columns["current_command_A"], dtype=np.float64), "A"
    return np.asarray(run.columns["force"], dtype=np.float64), run.units.get("force", "N m or N")


def _slope(position: FloatArray, period: float) -> FloatArray:
    if position.size < SLOPE_SAMPLES:
        return np.asarray(np.gradient(position, period))
    return np.asarray(savgol_filter(position, SLOPE_SAMPLES, polyorder=4, deriv=1, delta=period))


def _energy(run: Run, config: Config | None) -> tuple[RunEnergy | None, str | None]:
    try:
        return run_energy(run, config), None
    except RunFileError as error:
        return None, str(error).removeprefix(f"{run.path}: ").removeprefix(f"{run.path} ")


def _events(run: Run, time_s: FloatArray) -> list[tuple[float, str]]:
    """Changes of settings and lost rows, without the recorder's mark for the end of the run."""
    found = []
    for event in run.events:
        name = ", ".join(event["changed"]) if event.get("changed") else str(event.get("event", ""))
        if name in ("note", "marker"):
            name = note_text(event)[:_LONGEST_NAME]
        row = int(event.get("row", 0))
        if name and name != "end" and row < time_s.size:
            found.append((float(time_s[row]), name))
    return found


def _range(values: FloatArray, unit: str) -> dict[str, Any]:
    return {"min": float(np.nanmin(values)), "max": float(np.nanmax(values)), "unit": unit}


def _percentiles(seconds: FloatArray) -> dict[str, float]:
    p50, p99 = np.percentile(seconds, [50, 99])
    return {"p50_us": 1e6 * float(p50), "p99_us": 1e6 * float(p99), "max_us": 1e6 * float(seconds.max())}
