"""The energy ledger of a run file: its commands replayed through the model of its config (`energy_replay`).

An estimate, and called one everywhere: a recording holds counts and currents, not velocities. How far the model explains
the recording is part of the answer, as the energy left unexplained.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hapticd.config import Config, apply_settings, parse_config
from hapticd.record.errors import RunFileError
from hapticd.record.schema import FLAG_MISSED_EXCHANGE, FLAG_RUNNING, Rows, empty_rows
from hapticd.stability.bounds import Bounds, places_checked
from hapticd.stability.energy_records import PLACES
from hapticd.stability.energy_replay import EnergyEstimate
from hapticd.stability.outcome import energy_rises
from hapticd.stability.storage import FloatArray

if TYPE_CHECKING:
    from hapticd.record.run import Run

#: A stored energy that rises by less than this fraction of the run's largest is not called a rise: the estimate's grain.
RISE = 1e-6
_SHOTS = 8


@dataclass(frozen=True)
class RunEnergy:
    """Estimated energies of the last stretch of a run in which the spring was rendered; n rows, J.

    Attributes:
        config: the config at the beginning of the stretch.
        time_s: (n,). position: (n,) in rad or m from the spring's origin.
        energies: (n,) of `hapticd.stability.energy_records.ENERGIES`, since the start.
        bounds: the bounds on generation in every interval of force that is known to its end, in KΔ².
        notes: what a reader should know, in words.
    """

    config: Config
    time_s: FloatArray
    position: FloatArray
    energies: NDArray[Any]
    bounds: Bounds | None
    notes: tuple[str, ...]

    @property
    def unit(self) -> float:
        """KΔ² in J, the energy of one tick."""
        return self.config.spring.stiffness * self.config.resolution**2

    @property
    def unexplained(self) -> FloatArray:
        """(n,) a hand's work, changed settings and the model's errors since the start."""
        return np.asarray(self.energies["unexplained"] + self.energies["settings"])

    @property
    def residual(self) -> FloatArray:
        """(n,) what the balance (26) leaves over; rounding."""
        e = self.energies
        booked = e["viscous"] + e["coulomb"] - e["generated"] - self.unexplained
        return np.asarray(e["stored"] - e["stored"][0] + booked)

    @property
    def rises(self) -> int:
        """From how many samples to the next the stored energy rose beyond the grain of the estimate."""
        stored = self.energies["stored"]
        return int(np.count_nonzero(energy_rises(stored + RISE * stored.max(), RISE)))

    @property
    def explained(self) -> float | None:
        """1 less the fraction of what the model could not explain in all that was exchanged; None if nothing was."""
        e = self.energies
        exchanged = float(e["viscous"][-1] + e["coulomb"][-1] + np.abs(np.diff(e["generated"])).sum())
        if exchanged == 0.0:
            return None
        return max(0.0, 1.0 - float(np.abs(np.diff(self.unexplained)).sum()) / exchanged)

    @property
    def report(self) -> dict[str, Any]:
        """The JSON document of ``hapticd energy``."""
        stored, bounds = self.energies["stored"], self.bounds
        end = {name: float(self.energies[name][-1]) for name in self.energies.dtype.names or ()}
        return {
            "estimate": "through the model of the run's config",
            "rows": self.time_s.size,
            "duration_s": float(self.time_s[-1] - self.time_s[0]),
            "unit_J": self.unit,
            "stored_J": {"start": float(stored[0]), "end": end["stored"], "max": float(stored.max())},
            "dissipated_J": {
                "viscous": end["viscous"],
                "coulomb": end["coulomb"],
                "total": end["viscous"] + end["coulomb"],
            },
            "generated_J": end["generated"],
            "observed_J": {"put_out": end["put_out"], "generated": end["observed"]},
            "unexplained_J": float(self.unexplained[-1]),
            "explained": self.explained,
            "balance_residual_J": float(np.abs(self.residual).max()),
            "rises": self.rises,
            "bounds": None
            if bounds is None
            else {
                "intervals": bounds.way.size,
                "violations": {"paper": bounds.violations.size},
                "largest_excess_in_unit": {"paper": float(bounds.excess.max(initial=0.0))},
            },
            "notes": list(self.notes),
        }


def run_energy(run: Run, config: Config | None = None) -> RunEnergy:
    """Estimate the energies of a run.

    Args:
        run: as `hapticd.record.read_run` gives it.
        config: the config to use for a run that carries none; the run's own is used if it has one.

    Raises:
        RunFileError: no config in the run and none given, no rows, or a spring without stiffness.
        ConfigError: the run's config is not valid.
    """
    stored = run.metadata.get("config") or {}
    if stored:
        config = parse_config(stored, f"config of {run.path.name}")
    if config is None:
        raise RunFileError(f"{run.path} carries no config, so there is no model to replay it through; give one")
    rows = rows_of(run, config)
    if rows.size == 0:
        raise RunFileError(f"{run.path} has no rows")
    latency, origin = float(run.metadata.get("latency_s") or 0.0), run.metadata.get("origin_counts")
    estimate = EnergyEstimate(config, latency, origin, _first_velocity(config, latency, origin, rows))
    blocks = []
    for part, settings in _stretches(run, rows):
        if settings:
            origin = None if "spring.origin" in settings else estimate.origin_counts
            config = apply_settings(config, settings, source=f"settings changed during {run.path.name}")
            estimate.configure(config, latency, origin)
        blocks.append((config, part, *estimate.replayed(part)))
    return _last_start(run, blocks)


def rows_of(run: Run, config: Config) -> Rows:
    """The rows of a run, whatever columns it has: a foreign run has a position and a force, and ran all the time."""
    columns = run.columns
    rows = empty_rows(run.rows)
    for name in rows.dtype.names or ():
        if name in columns:
            rows[name] = columns[name]
    if "tick" not in columns:
        rows["tick"] = np.arange(rows.size)
    if "flags" not in columns:
        rows["flags"] = FLAG_RUNNING
    if "encoder_counts" not in columns:
        rows["encoder_counts"] = np.floor(columns["position"] / config.raw_resolution)
    if "current_command_A" not in columns:
        rows["current_command_A"] = columns["force"] / config.amplifier.torque_constant
    return rows


def _first_velocity(config: Config, latency: float, origin: int | None, rows: Rows) -> float:
    """Velocity with which the model meets the second count, to one count; 0 if it does so from rest."""
    pair = rows[:2].copy()
    if pair.size < 2 or not pair["time_s"][1] > pair["time_s"][0]:
        return 0.0
    # a sample that says nothing corrects nothing, and shows where the model has gone by itself
    pair["flags"][1] |= FLAG_MISSED_EXCHANGE
    raw, dt = config.raw_resolution, float(pair["time_s"][1] - pair["time_s"][0])
    velocity = 0.0
    for _ in range(_SHOTS):
        estimate = EnergyEstimate(config, latency, origin, velocity)
        reached = estimate.replayed(pair)[1]["sampled"][1]
        miss = (pair["encoder_counts"][1] - estimate.origin_counts + 0.5) * raw - reached
        if abs(miss) <= raw:
            break
        velocity += miss / dt
    return velocity


def _stretches(run: Run, rows: Rows) -> Iterator[tuple[Rows, dict[str, Any]]]:
    """The rows between two changes of settings, each with the settings that were changed before it."""
    changes = [event for event in run.events if event.get("event") == "set" and event.get("changed")]
    edges = [0, *(min(int(event["row"]), rows.size) for event in changes), rows.size]
    settings: list[dict[str, Any]] = [{}, *(event["changed"] for event in changes)]
    for (first, last), changed in zip(itertools.pairwise(edges), settings, strict=True):
        yield rows[first:last], changed


def _last_start(run: Run, blocks: list[tuple[Config, Rows, NDArray[Any], NDArray[Any]]]) -> RunEnergy:
    """Cut out what followed the last start, and check the bounds there."""
    configs, *parts = zip(*blocks, strict=True)
    ends = np.cumsum([part.size for part in parts[0]])
    rows, energies, places = (np.concatenate(part) for part in parts)
    running = rows["flags"] & FLAG_RUNNING != 0
    if not running.any():
        raise RunFileError(
            f"{run.path}: the spring was never rendered in this run, so there is no energy to account for"
        )
    last = int(np.flatnonzero(running)[-1]) + 1
    stopped = np.flatnonzero(~running[:last])
    first = int(stopped[-1]) + 1 if stopped.size else 0
    within = int(np.searchsorted(ends, first, side="right"))
    config = configs[within]
    if config.spring.stiffness == 0.0:
        raise RunFileError(f"{run.path}: spring.stiffness is 0, there is no spring whose energy could be accounted for")
    span = slice(first, last)
    notes = list(run.warnings)
    if running[:first].any():
        notes.append(f"the spring was started more than once: the ledger is of the last start, from row {first} on")
    changed = any(first < end < last for end in ends)
    if changed:
        notes.append("settings were changed on the way; the bounds are checked up to the first change")
    return RunEnergy(
        config=config,
        time_s=rows["time_s"][span],
        position=places["sampled"][span],
        energies=energies[span],
        bounds=_bounds(config, places[first : min(last, int(ends[within]))], notes),
        notes=tuple(notes),
    )


def _bounds(config: Config, places: NDArray[Any], notes: list[str]) -> Bounds | None:
    """The bounds in the intervals of a run; None where the spring is not the one of (2)."""
    if config.spring.side != "both" or not config.spring.half_tick_bias or config.dither.target != "none":
        notes.append("the bounds are not checked: they are for a bidirectional spring with its half tick, undithered")
        return None
    late = math.floor(config.delay.computation_s / config.period + 1e-6)
    known = np.isfinite(places["end"])
    known[:late] = False
    row = np.flatnonzero(known)
    sampled, *visited = (places[name] / config.resolution for name in PLACES.names or ())
    return places_checked(sampled[row - late], *(place[row] for place in visited))
