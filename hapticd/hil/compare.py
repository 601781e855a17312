"""How far a recorded run on the device is from the same run in `simulate`, with the declared latency.

The loop is nonlinear and the end of a long release is sensitive to thousandths of a tick, so three things are compared:
the outcome, where the shaft ended, and the current trace over the first swing, before such differences have grown.
The simulation ticks when the recorded loop did. It is an ensemble: of places in the raw count where the shaft may have
begun, and where the plant is uncertain (``plant.uncertainty``), of plants.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from drivers import declared_latency
from hapticd.config import Driver
from hapticd.record import RunFileError, read_run
from hapticd.record.schema import FLAG_DROPPED, FLAG_MISSED_PERIOD, FLAG_RUNNING
from hapticd.servo.simulate import simulate
from hapticd.stability.draws import deviations, moved, normals

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.config import Config
    from hapticd.record import Run

LOG2_DRAWS: Final = 5
_GOLDEN: Final = 0.5 * (5.0**0.5 - 1.0)
"""Its multiples, modulo 1, fill the unit interval evenly at any number of them."""
GROWTH: Final = ("over_speed", "excursion", "over_current", "encoder_jump")
"""Faults that end a growing oscillation, as they should."""


@dataclass(frozen=True)
class Trace:
    """One run from the first tick in which the spring was rendered."""

    time_s: NDArray[np.float64]
    ticks: NDArray[np.float64]
    """Position in coarse ticks from the spring's origin, exact to one raw count."""
    current: NDArray[np.float64]
    """Commanded current, A."""


@dataclass(frozen=True)
class Comparison:
    """A run on the device beside its simulation."""

    measured: Trace
    simulated: Trace
    swing: int
    """Periods of the first swing, over which the traces are compared."""
    current_rms_error: float
    """RMS difference of the current over the first swing, as a fraction of its RMS."""
    position_rms_error: float
    """RMS difference of the position over the first swing, ticks."""


def recorded_times(run: Run, count: int | None = None) -> NDArray[np.int64]:
    """Numbers and lateness, ns, of the ticks in which a recorded loop rendered its spring, shape (2, n).

    Args:
        run: of hapticd.
        count: of periods; where it ended earlier ticks on the grid follow, where later the rest is left out.

    Raises:
        RunFileError: it has no such rows, or some of them are missing that the loop has not.
    """
    if missing := [name for name in ("tick", "wake_late_ns", "flags") if name not in run.columns]:
        raise RunFileError(f"{run.path} has no column {missing[0]}: only a recording of hapticd can be replayed")
    rendered = np.flatnonzero(run.columns["flags"] & FLAG_RUNNING)
    if not rendered.size:
        raise RunFileError(f"{run.path}: the spring is not rendered in it")
    part = slice(rendered[0], rendered[-1] + 1)
    tick, late_ns, flags = (run.columns[name][part] for name in ("tick", "wake_late_ns", "flags"))
    jumped = np.flatnonzero(np.diff(tick) != 1) + 1
    if (np.diff(tick) < 1).any() or (flags[jumped] & FLAG_MISSED_PERIOD == 0).any() or (flags & FLAG_DROPPED).any():
        raise RunFileError(f"{run.path}: rows are missing in which the loop has ticked: they cannot be replayed")
    times = np.stack([tick, np.maximum(late_ns, 0)]).astype(np.int64)
    if count is None:
        return times
    end = tick[0] + count
    later = np.arange(tick[-1] + 1, end)
    return np.hstack([times[:, tick < end], np.stack([later, np.zeros_like(later)])])


def measured_trace(path: Path, config: Config) -> Trace:
    """The rendered part of a recording."""
    run = read_run(path)
    running = np.flatnonzero(run.columns["flags"] & FLAG_RUNNING)
    rows = slice(int(running[0]), int(running[-1]) + 1) if len(running) else slice(0, 0)
    counts = run.columns["encoder_counts"][rows].astype(float)
    # What the spring saw names its origin, wherever the experiment had put it: ticks = floor((counts - origin) / N).
    origin = float(run.metadata["origin_counts"])
    time_s = run.columns["time_s"][rows]
    return Trace(
        time_s - (time_s[0] if len(time_s) else 0.0),
        (counts - origin) / config.encoder.decimation,
        run.columns["current_command_A"][rows],
    )


def simulated_trace(
    config: Config,
    duration_s: float,
    deflection: float,
    excitation: NDArray[np.float64] | None = None,
    times: NDArray[np.int64] | None = None,
) -> tuple[Trace, dict[str, Any]]:
    """The same run in virtual time, at the recorded ``times`` if they are given, and the simulation's report."""
    blocks: list[NDArray[Any]] = []
    report = simulate(
        config,
        duration_s,
        deflection=deflection,
        excitation=excitation,
        replay=times,
        safety=True,  # as the daemon has: growth ends in a fault, and the current is clamped
        on_rows=lambda rows: blocks.append(rows.copy()),
    )
    if report["fault"] and report["fault"]["code"] in GROWTH:
        report = {**report, "outcome": "growing"}
    rows = np.concatenate(blocks)
    counts = (rows["encoder_counts"] - config.origin_counts).astype(float)
    return Trace(rows["time_s"], counts / config.encoder.decimation, rows["current_command_A"]), report


def possible(config: Config, log2_draws: int = LOG2_DRAWS) -> list[tuple[Config, float]]:
    """What a release may have been: a plant, and where in its raw count the shaft stood, coarse ticks above the count.

    The encoder tells no more than the count, and a release that grows or goes on forgets no start. The plant is the config's
    first, then one of `2**log2_draws` that its uncertainty leaves possible.
    """
    plant, declared = config.plant, declared_latency(config)[0]
    plants = [config]
    if plant.uncertainty.is_known:
        errors = normals(plant.uncertainty, log2_draws) * deviations(plant.uncertainty)
        for inertia, viscous, coulomb, late_s in errors.tolist():
            drawn = {
                "inertia": moved(plant.inertia, inertia),
                "viscous": moved(plant.viscous, viscous),
                "coulomb": moved(plant.coulomb, coulomb),
            }
            trial = config.model_copy(update={"plant": plant.model_copy(update=drawn)})
            plants.append(_with_latency(trial, max(declared + late_s, 0.0)))
    starts = np.mod(0.5 + _GOLDEN * np.arange(1 + 2**log2_draws), 1.0) / config.encoder.decimation
    return [(plants[n % len(plants)], float(start)) for n, start in enumerate(starts)]


def rest_torque(trace: Trace, config: Config) -> float:
    """Torque or force of the motor at the end of a trace, N m or N: its mean over the last tenth, for a dither goes on."""
    return config.amplifier.torque_constant * float(np.mean(trace.current[-max(len(trace.current) // 10, 1) :]))


def _with_latency(config: Config, latency_s: float) -> Config:
    return config.model_copy(update={"driver": Driver(**{**config.driver.model_dump(), "latency_s": latency_s})})


def compare(measured: Trace, simulated: Trace, span: int | None = None) -> Comparison:
    """Compare two traces.

    Args:
        measured: on the device. simulated: in virtual time, at the same ticks.
        span: periods to compare; None: up to the end of the first swing there and back.
    """
    length = min(len(measured.ticks), len(simulated.ticks))
    swing = min(length, span if span is not None else first_swing(simulated.ticks))
    current = measured.current[:swing] - simulated.current[:swing]
    scale = _rms(simulated.current[:swing])
    return Comparison(
        measured,
        simulated,
        swing,
        _rms(current) / scale if scale else _rms(current),
        _rms(measured.ticks[:swing] - simulated.ticks[:swing]),
    )


def first_swing(ticks: NDArray[np.float64]) -> int:
    """Periods until the second reversal: once through the origin and back; at least 5."""
    moves = np.flatnonzero(np.diff(ticks))
    direction = np.sign(np.diff(ticks)[moves])
    turns = moves[1:][np.diff(direction) != 0]
    return max(5, int(turns[1]) + 1 if len(turns) > 1 else len(ticks))


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0
