"""The energy ledger of a run file: its commands replayed through the model of its config (`energy_replay`).

It is an estimate: a recording contains counts and currents, not velocities. The unexplained energy shows how well the model
explains the recording.
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
from hapticd.stability.bounds import Bounds, bounds_of_positions
from hapticd.stability.energy_records import POSITIONS
from hapticd.stability.energy_replay import EnergyEstimate
from hapticd.stability.outcome import energy_rises
from hapticd.stability.storage import FloatArray

if TYPE_CHECKING:
    from hapticd.record.run import Run

#: Smallest rise of the stored energy that counts, as a fraction of the run's largest: resolution of the estimate.
RISE = 1e-6
_SHOTS = 8


@dataclass(frozen=True)
class RunEnergy:
    """Estimated energies of the last stretch of a run in which the spring was rendered; n rows, J.

    Attributes:
        config: the config at the beginning of the stretch.
        time_s: (n,). position: (n,) in rad or m from the spring's origin.
        energies: (n,) of `hapticd.stability.energy_records.ENERGIES`, from the start of the spring on.
        bounds: the bounds on generated energy in every complete interval of force, in KΔ².
        notes: restrictions of the result, in words.
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
        """(n,) work of a hand, of changed settings and of model errors since the start."""
        return np.asarray(self.energies["unexplained"] + self.energies["settings"])

    @property
    def residual(self) -> FloatArray:
        """(n,) remainder of the balance (26); rounding."""
        e = self.energies
        booked = e["viscous"] + e["coulomb"] - e["generated"] - self.unexplained
        return np.asarray(e["stored"] - e["stored"][0] + booked)

    @property
    def rises(self) -> int:
        """Number of samples after which the stored energy rose by more than `RISE`."""
        stored = self.energies["stored"]
        return int(np.count_nonzero(energy_rises(stored + RISE * stored.max(), RISE)))

    @property
    def explained(self) -> float | None:
        """1 − unexplained energy/exchanged energy; None if none was exchanged."""
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
                "intervals": bounds.displacement.size,
                "violations": {"paper": bounds.violations.size},
                "largest_excess_in_unit": {"paper": float(bounds.excess.max(initial=0.0))},
            },
            "notes": list(self.notes),
        }


def run_energy(run: Run, config: Config | None = None) -> RunEnergy:
    """Estimate the energies of a run.

    Args:
        run: from `hapticd.record.read_run`.
        config: for a run without a config; otherwise the run's is used.

    Raises:
        RunFileError: no config in the run and none given, no rows, or a spring without stiffness.
        ConfigError: the run's config is not valid.
    """
    stored = run.metadata.get("config") or {}
    if stored:
        config = parse_config(stored, f"config of {run.path.name}")
    if config is None:
        raise RunFileError(f"{run.path} carries no config, so there is no model for its energies; give one")
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
    """The rows of a run: an imported one has position and force, and counts as running all the time."""
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
    """Initial velocity with which the model reaches the second count, within one count; 0 if it does so from rest."""
    pair = rows[:2].copy()
    if pair.size < 2 or not pair["time_s"][1] > pair["time_s"][0]:
        return 0.0
    # a sample without counts corrects nothing, and shows the uncorrected position of the model
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
    """The rows between two changes of settings, with the settings changed before them."""
    changes = [event for event in run.events if event.get("event") == "set" and event.get("changed")]
    edges = [0, *(min(int(event["row"]), rows.size) for event in changes), rows.size]
    settings: list[dict[str, Any]] = [{}, *(event["changed"] for event in changes)]
    for (first, last), changed in zip(itertools.pairwise(edges), settings, strict=True):
        yield rows[first:last], changed


def _last_start(run: Run, blocks: list[tuple[Config, Rows, NDArray[Any], NDArray[Any]]]) -> RunEnergy:
    """Select the rows after the last start, and check the bounds there."""
    configs, *parts = zip(*blocks, strict=True)
    ends = np.cumsum([part.size for part in parts[0]])
    rows, energies, positions = (np.concatenate(part) for part in parts)
    running = rows["flags"] & FLAG_RUNNING != 0
    if not running.any():
        raise RunFileError(f"{run.path}: the spring was never rendered in this run, so there is no energy to compute")
    last = int(np.flatnonzero(running)[-1]) + 1
    stopped = np.flatnonzero(~running[:last])
    first = int(stopped[-1]) + 1 if stopped.size else 0
    within = int(np.searchsorted(ends, first, side="right"))
    config = configs[within]
    if config.spring.stiffness == 0.0:
        raise RunFileError(f"{run.path}: spring.stiffness is 0, so there is no spring energy to compute")
    span = slice(first, last)
    notes = list(run.warnings)
    if running[:first].any():
        notes.append(f"the spring was started more than once: the ledger is of the last start, from row {first} on")
    changed = any(first < end < last for end in ends)
    if changed:
        notes.append("settings were changed during the run; the bounds are checked up to the first change")
    return RunEnergy(
        config=config,
        time_s=rows["time_s"][span],
        position=positions["sampled"][span],
        energies=energies[span],
        bounds=_bounds(config, positions[first : min(last, int(ends[within]))], notes),
        notes=tuple(notes),
    )


def _bounds(config: Config, positions: NDArray[Any], notes: list[str]) -> Bounds | None:
    """The bounds in the intervals of a run; None if the spring is not that of (2)."""
    if config.spring.side != "both" or not config.spring.half_tick_bias or config.dither.target != "none":
        notes.append(
            "the bounds are not checked: they hold for a two-sided spring with the half-tick bias, without dither"
        )
        return None
    late = math.floor(config.delay.computation_s / config.period + 1e-6)
    known = np.isfinite(positions["end"])
    known[:late] = False
    row = np.flatnonzero(known)
    sampled, *visited = (positions[name] / config.resolution for name in POSITIONS.names or ())
    return bounds_of_positions(sampled[row - late], *(position[row] for position in visited))
