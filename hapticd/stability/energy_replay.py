"""Energies of a run, estimated by a model: recorded commands drive the exact device model, encoder counts correct it.

A recording has neither velocity nor position between two counts, so its energies can only be estimated. The model of
the config is moved exactly from sample to sample under the recorded currents, each from the instant at which it acts:
the row's time, plus its lateness, T_V modulo the period (the recorded current contains the whole periods), T_A and
the driver's latency. If the model is outside the count that was read, it is moved into it, and a difference that a position
error of one count cannot explain corrects the velocity.

A correction counts as motion: the energies of friction and spring are computed on it, and the remainder of the balance (26)
is the work that is not recorded: a hand's ∫φ_H ξ̇, and the errors of the model. It is stored separately, as ``unexplained``.

SI units; positions from the spring's origin. The same kernel serves run files and the running daemon.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import from_dtype, types
from numpy.typing import NDArray

from hapticd.jit import njit
from hapticd.record.schema import (
    FLAG_EXCITATION,
    FLAG_MISSED_EXCHANGE,
    FLAG_MISSED_PERIOD,
    FLAG_RUNNING,
    ROW,
    Rows,
    check_rows,
)
from hapticd.stability.energy_records import ENERGIES, POSITIONS, QUEUE_LENGTH, REPLAY, model_of
from hapticd.stability.passivity import spring_potential
from hapticd.stability.segments import move

if TYPE_CHECKING:
    from hapticd.config import Config

_MASK = QUEUE_LENGTH - 1
#: Share of a correction within one count that corrects the velocity.
_GAIN = 0.1

_f8 = types.float64
_replay = from_dtype(REPLAY)
_replays, _rows, _energies, _positions = (
    types.Array(from_dtype(record), 1, "C") for record in (REPLAY, ROW, ENERGIES, POSITIONS)
)


@njit(_f8(_replay, _f8), inline=True, counted=False)
def _potential(r: Any, x: float) -> float:
    model = r.model
    return float(model.stiffness * model.tick * model.tick * spring_potential(x / model.tick, model.bias, model.side))


@njit(_f8(_replay), counted=False)
def _stored(r: Any) -> float:
    """H_T (35) of the model's present state in J, with the energy of a hand's spring."""
    stretch = r.position - r.model.hand_rest
    elastic = _potential(r, r.position) + 0.5 * r.model.hand_stiffness * stretch * stretch
    return float(elastic + 0.5 * r.model.inertia * r.velocity * r.velocity)


@njit(types.void(_replay, _f8, _positions), inline=True, counted=False)
def _advance(r: Any, until: float, positions: NDArray[Any]) -> None:
    """Move the model under its present force, and add up the energies while the spring is rendered."""
    dt = until - r.time
    if not dt > 0.0:
        return
    r.time = until
    model, begin, rest = r.model, r.position, r.model.hand_rest
    x, r.velocity, drag, path, low, high = move(
        begin - rest, r.velocity, dt, r.force, model.inertia, model.viscous, model.coulomb, model.hand_stiffness
    )
    x += rest
    r.position = x
    if not r.running:
        return
    r.energies.viscous += drag
    r.energies.coulomb += model.coulomb * path
    r.energies.generated += r.force * (x - begin) + _potential(r, x) - _potential(r, begin)
    if 0 <= r.acting < len(positions):
        position = positions[r.acting]
        position.low = min(position.low, low + rest)
        position.high = max(position.high, high + rest)


@njit(types.void(_replay, _f8, _positions), counted=False)
def _advance_through_commands(r: Any, until: float, positions: NDArray[Any]) -> None:
    while r.tail < r.head:
        command = r.queue[r.tail & _MASK]
        if command.time > until:
            break
        _advance(r, command.time, positions)
        if 0 <= r.acting < len(positions):
            positions[r.acting].end = r.position
        r.force, r.acting = command.force, command.row - r.began
        if 0 <= r.acting < len(positions):
            position = positions[r.acting]
            position.start = position.low = position.high = r.position
        r.tail += 1
    _advance(r, until, positions)


@njit(types.void(_replay, _f8), counted=False)
def _correct(r: Any, dt: float) -> None:
    """Move the model into the count that was read, with the energies of friction and spring."""
    model, energies, x = r.model, r.energies, r.position
    raw = model.count
    low, high = r.counts * raw, (r.counts + 1.0 - 1e-9) * raw
    error = min(max(x, low), high) - x
    if error == 0.0 or not dt > 0.0:
        return
    before, potential = _stored(r), _potential(r, x)
    size = abs(error)
    velocity = (max(size - raw, 0.0) + _GAIN * min(size, raw)) / dt
    r.position = x + error
    r.velocity += math.copysign(velocity, error)
    if not r.running:
        return
    viscous, coulomb = model.viscous * error * error / dt, model.coulomb * size
    generated = r.force * error + _potential(r, r.position) - potential
    energies.viscous += viscous
    energies.coulomb += coulomb
    energies.generated += generated
    energies.unexplained += _stored(r) - before + viscous + coulomb - generated


@njit(types.void(_replay, types.int64), inline=True, counted=False)
def _observe(r: Any, counts: int) -> None:
    """The energies of `hapticd.servo._passivity` in the period before a row."""
    before, now = (r.counts + 0.5) * r.model.count, (counts + 0.5) * r.model.count
    work = r.current * r.model.torque_constant * (now - before)
    r.energies.put_out += work
    r.energies.observed += work + _potential(r, now) - _potential(r, before)


@njit(types.void(_replay, types.int64, _f8), counted=False)
def _begin_anew(r: Any, counts: int, now: float) -> None:
    """Set the model to the middle of the count that was read: at the first row, and after lost rows.

    The velocity at the first row is that of the initial state.
    """
    before = _stored(r)
    dt = now - r.time
    if r.seen:
        r.velocity = (counts - r.counts) * r.model.count / dt if dt > 0.0 else 0.0
    r.position = (counts + 0.5) * r.model.count
    r.time, r.tail, r.acting = now, r.head, -1
    if r.running:
        r.energies.unexplained += _stored(r) - before


@njit(types.void(_replays, _rows, _energies, _positions), counted=False)
def replay(kept: NDArray[Any], rows: Rows, energies: NDArray[Any], positions: NDArray[Any]) -> None:
    """Process the next rows.

    Args:
        kept: (1,) of `REPLAY`, from call to call. rows: (n,) of `record.ROW`, in order.
        energies: (n,) of `ENERGIES` after each row, or (0,).
        positions: (n,) of `POSITIONS`, or (0,); unchanged where the force did not act to its end.
    """
    r = kept[0]
    r.began, r.acting = r.rows, -1
    for k in range(len(rows)):
        row = rows[k]
        late = max(row.wake_late_ns, 0) * 1e-9
        now = row.time_s + late
        dt = now - r.time
        counts = row.encoder_counts - r.model.origin
        lost = row.tick != r.tick + 1 and row.flags & FLAG_MISSED_PERIOD == 0
        if not r.seen or lost or not dt > 0.0:
            _begin_anew(r, counts, now)
            r.counts = counts
        else:
            _advance_through_commands(r, now, positions)
            if r.running and not r.excited:
                _observe(r, counts)
            r.counts = counts
            if row.flags & FLAG_MISSED_EXCHANGE == 0:
                _correct(r, dt)
        r.tick, r.seen = row.tick, True

        running = row.flags & FLAG_RUNNING != 0
        if running and not r.running:
            booked = r.energies
            booked.viscous = booked.coulomb = booked.generated = booked.unexplained = booked.settings = 0.0
            booked.put_out = booked.observed = 0.0
            booked.start = _stored(r)
        if running:
            r.energies.stored = _stored(r)
        r.running, r.excited = running, row.flags & FLAG_EXCITATION != 0
        r.current = row.current_command_A

        if r.head - r.tail < QUEUE_LENGTH:
            command = r.queue[r.head & _MASK]
            wait = max(late, r.model.within_period) if running else late
            command.time, command.row = row.time_s + wait + r.model.lag, r.rows
            command.force = row.current_command_A * r.model.torque_constant
            r.head += 1
        r.rows += 1
        if len(energies) > 0:
            energies[k] = r.energies
        if len(positions) > 0:
            positions[k].sampled = r.position


_NO_ENERGIES, _NO_POSITIONS = np.zeros(0, ENERGIES), np.zeros(0, POSITIONS)


class EnergyEstimate:
    """Stored, dissipated and generated energy since the last start, estimated by the model (`energy_replay`).

    Rows without ``FLAG_RUNNING`` correct the model and add no energy; each start resets the energies. One thread calls
    `update` and `configure`; `status` may be called from another, and its sums may then differ by one row.

    Args:
        config: the present config. latency_s: the driver's declared latency.
        origin_counts: raw count of the spring's present origin; None: the config's.
        velocity: at the first row, in rad/s or m/s.

    Example:
        >>> from hapticd.config import load_config
        >>> estimate = EnergyEstimate(load_config(None))
        >>> estimate.status()["stored_J"]
        0.0
    """

    def __init__(
        self, config: Config, latency_s: float = 0.0, origin_counts: int | None = None, velocity: float = 0.0
    ) -> None:
        self._kept = np.zeros(1, REPLAY)
        self._kept["model"] = model_of(config, latency_s, origin_counts)
        self._kept["velocity"] = velocity

    def configure(self, config: Config, latency_s: float = 0.0, origin_counts: int | None = None) -> None:
        """Use changed settings from the next row on.

        The change of the spring's stored energy is the work of the settings, ``settings_J``.
        """
        r, model = self._kept[0], model_of(config, latency_s, origin_counts)
        before = _stored(r)
        shift = self.origin_counts - int(model["origin"])
        r["position"] += shift * model["count"]
        r["counts"] += shift
        r["model"] = model
        if r["running"]:
            energies = r["energies"]
            energies["stored"] = _stored(r)
            energies["settings"] += energies["stored"] - before

    @property
    def origin_counts(self) -> int:
        """Raw count of the spring's present origin."""
        return int(self._kept[0]["model"]["origin"])

    def update(self, rows: Rows) -> None:
        """Process the next rows, (n,) of `record.ROW` in order; n may be 0.

        Raises:
            TypeError: the rows are not of `record.ROW`.
        """
        check_rows(rows)
        replay(self._kept, np.ascontiguousarray(rows), _NO_ENERGIES, _NO_POSITIONS)

    def status(self) -> dict[str, Any]:
        """Energies in J since the last start.

        Returns:
            ``stored_J`` now and ``stored_at_start_J``; since then ``dissipated_J``, ``generated_J``, ``settings_J``
            (changed settings) and ``unexplained_J``: a hand's work and the model's errors. They balance:
            stored = stored_at_start − dissipated + generated + settings + unexplained. ``estimate``: how they are known.
        """
        energies = self._kept[0]["energies"]
        return {
            "estimate": "through the model",
            "stored_J": float(energies["stored"]),
            "stored_at_start_J": float(energies["start"]),
            "dissipated_J": float(energies["viscous"] + energies["coulomb"]),
            "generated_J": float(energies["generated"]),
            "settings_J": float(energies["settings"]),
            "unexplained_J": float(energies["unexplained"]),
        }

    def replayed(self, rows: Rows) -> tuple[NDArray[Any], NDArray[Any]]:
        """`update`, with the result of every row.

        Returns:
            (n,) of `ENERGIES`, J, and (n,) of `POSITIONS`, rad or m, in which ``end`` is NaN where the row's force
            is not known to its end.
        """
        check_rows(rows)
        energies, positions = np.zeros(rows.size, ENERGIES), np.full(rows.size, np.nan, POSITIONS)
        replay(self._kept, np.ascontiguousarray(rows), energies, positions)
        return energies, positions
