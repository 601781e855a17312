"""Energies of a run through the model: recorded commands drive the exact device model, the encoder keeps it on track.

A recording has neither the velocity nor the place between two counts, so its energies can only be estimated. The model of
the config is moved exactly from sample to sample under the recorded currents, each from the instant at which it acted:
the row's time, its lateness, the part of T_V below a period (whole periods are in the recorded current already), T_A and
the driver's latency. Where the model is not within the count that was read, it is moved there, and what a wrong place
of one count cannot explain is taken for a wrong velocity.

Such a correction is motion too: friction and the spring are booked on it, and what then is missing in the balance (26) is
the work that nobody recorded: a hand's ∫φ_H ξ̇, and the errors of the model. It is kept apart as ``unexplained``.

SI units; positions from the spring's origin. The same kernel serves run files and the running daemon.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

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
from hapticd.stability.passivity import spring_potential
from hapticd.stability.segments import move_with_stiffness
from hapticd.stability.storage import FloatArray

if TYPE_CHECKING:
    from hapticd.config import Config

(
    P_INERTIA, P_VISCOUS, P_COULOMB, P_HAND_STIFFNESS, P_HAND_REST, P_STIFFNESS, P_RESOLUTION, P_BIAS, P_SIDE, P_RAW,
    P_ORIGIN, P_TORQUE_CONSTANT, P_LAG, P_WITHIN_PERIOD, PARAMETERS,
) = range(15)  # fmt: skip

(
    S_POSITION, S_VELOCITY, S_TIME, S_FORCE, S_VISCOUS, S_COULOMB, S_GENERATED, S_UNEXPLAINED, S_SETTINGS, S_START,
    S_STORED, S_SEEN, S_RUNNING, S_TICK, S_COUNTS, S_HEAD, S_TAIL, S_ACTING, S_BEGAN, S_ROWS, S_CURRENT, S_EXCITED,
    S_PUT_OUT, S_OBSERVED, STATE_WORDS,
) = range(25)  # fmt: skip

#: Columns of a row's energies, all since the start: stored, viscous, coulomb, generated, unexplained; and the position;
#: and what the passivity observer books from counts and currents alone: put out by the current, generated.
O_STORED, O_VISCOUS, O_COULOMB, O_GENERATED, O_UNEXPLAINED, O_POSITION, O_PUT_OUT, O_OBSERVED, OUTPUTS = range(9)
#: Columns of the places visited while the force of a row acted: at its start and end, the extremes.
L_START, L_END, L_LOW, L_HIGH, PLACES = range(5)

QUEUE_LENGTH: Final = 4096
_MASK = QUEUE_LENGTH - 1
#: Share of a correction within one count that is taken for a wrong velocity.
_GAIN = 0.1
_SIDES: Final = {"both": 0.0, "positive": 1.0, "negative": -1.0}

_f8 = types.float64
_F = types.Array(_f8, 1, "C")
_F2 = types.Array(_f8, 2, "C")
_ROWS = types.Array(from_dtype(ROW), 1, "C")


def replay_parameters(config: Config, latency_s: float = 0.0, origin_counts: int | None = None) -> FloatArray:
    """The model of a config as the kernel's parameters, (PARAMETERS,).

    Args:
        config: a resolved configuration. latency_s: the driver's declared latency.
        origin_counts: raw count of the spring's origin in force; None: the config's.
    """
    p = np.zeros(PARAMETERS)
    raw, origin = config.raw_resolution, config.origin_counts if origin_counts is None else origin_counts
    p[P_INERTIA] = config.plant.inertia + config.hand.inertia
    p[P_VISCOUS] = config.plant.viscous + config.hand.damping
    p[P_COULOMB] = config.plant.coulomb
    p[P_HAND_STIFFNESS] = config.hand.stiffness
    p[P_HAND_REST] = (config.origin_counts - origin) * raw
    p[P_STIFFNESS], p[P_RESOLUTION] = config.spring.stiffness, config.resolution
    p[P_BIAS] = 0.5 if config.spring.half_tick_bias else 0.0
    p[P_SIDE] = _SIDES[config.spring.side]
    p[P_RAW], p[P_ORIGIN] = raw, origin
    p[P_TORQUE_CONSTANT] = config.amplifier.torque_constant
    p[P_LAG] = config.amplifier.delay + latency_s
    periods = config.delay.computation_s / config.period
    # a delay of whole periods must not become one of a whole period less a rounding
    p[P_WITHIN_PERIOD] = max(0.0, periods - math.floor(periods + 1e-6)) * config.period
    return p


def replay_state() -> FloatArray:
    """A kernel's memory before the first row: state, then the queue of commands on their way."""
    return np.zeros(STATE_WORDS + 3 * QUEUE_LENGTH)


@njit(_f8(_F, _f8), inline=True)
def _potential(p: NDArray[np.float64], x: float) -> float:
    tick = p[P_RESOLUTION]
    return float(p[P_STIFFNESS] * tick * tick * spring_potential(x / tick, p[P_BIAS], p[P_SIDE]))


@njit(_f8(_F, _F))
def stored_energy(p: NDArray[np.float64], s: NDArray[np.float64]) -> float:
    """H_T (35) of the model's present state in J, a hand's spring included."""
    stretch = s[S_POSITION] - p[P_HAND_REST]
    elastic = _potential(p, s[S_POSITION]) + 0.5 * p[P_HAND_STIFFNESS] * stretch * stretch
    return float(elastic + 0.5 * p[P_INERTIA] * s[S_VELOCITY] * s[S_VELOCITY])


@njit(types.void(_F, _F, _f8, _F2), inline=True)
def _advance(p: NDArray[np.float64], s: NDArray[np.float64], until: float, places: NDArray[np.float64]) -> None:
    """Move the model under its present force, and book the energies while the spring is rendered."""
    dt = until - s[S_TIME]
    if not dt > 0.0:
        return
    s[S_TIME] = until
    begin, rest = s[S_POSITION], p[P_HAND_REST]
    x, v, drag, path, low, high = move_with_stiffness(
        begin - rest, s[S_VELOCITY], dt, s[S_FORCE], p[P_INERTIA], p[P_VISCOUS], p[P_COULOMB], p[P_HAND_STIFFNESS]
    )
    x += rest
    s[S_POSITION], s[S_VELOCITY] = x, v
    if s[S_RUNNING] == 0.0:
        return
    s[S_VISCOUS] += drag
    s[S_COULOMB] += p[P_COULOMB] * path
    s[S_GENERATED] += s[S_FORCE] * (x - begin) + _potential(p, x) - _potential(p, begin)
    row = int(s[S_ACTING])
    if 0 <= row < len(places):
        places[row, L_LOW] = min(places[row, L_LOW], low + rest)
        places[row, L_HIGH] = max(places[row, L_HIGH], high + rest)


@njit(types.void(_F, _F, _f8, _F2))
def _advance_through_commands(
    p: NDArray[np.float64], s: NDArray[np.float64], until: float, places: NDArray[np.float64]
) -> None:
    while s[S_TAIL] < s[S_HEAD]:
        slot = STATE_WORDS + 3 * (int(s[S_TAIL]) & _MASK)
        if s[slot] > until:
            break
        _advance(p, s, s[slot], places)
        row = int(s[S_ACTING])
        if 0 <= row < len(places):
            places[row, L_END] = s[S_POSITION]
        s[S_FORCE], s[S_ACTING] = s[slot + 1], s[slot + 2] - s[S_BEGAN]
        row = int(s[S_ACTING])
        if 0 <= row < len(places):
            places[row, L_START] = places[row, L_LOW] = places[row, L_HIGH] = s[S_POSITION]
        s[S_TAIL] += 1.0
    _advance(p, s, until, places)


@njit(types.void(_F, _F, _f8, _f8))
def _correct(p: NDArray[np.float64], s: NDArray[np.float64], counts: float, dt: float) -> None:
    """Bring the model into the count that was read; friction and spring are booked on the way there."""
    raw = p[P_RAW]
    low, high = counts * raw, (counts + 1.0 - 1e-9) * raw
    x = s[S_POSITION]
    error = min(max(x, low), high) - x
    if error == 0.0 or not dt > 0.0:
        return
    before, potential = stored_energy(p, s), _potential(p, x)
    size = abs(error)
    velocity = (max(size - raw, 0.0) + _GAIN * min(size, raw)) / dt
    s[S_POSITION] = x + error
    s[S_VELOCITY] += math.copysign(velocity, error)
    if s[S_RUNNING] == 0.0:
        return
    viscous, coulomb = p[P_VISCOUS] * error * error / dt, p[P_COULOMB] * size
    generated = s[S_FORCE] * error + _potential(p, s[S_POSITION]) - potential
    s[S_VISCOUS] += viscous
    s[S_COULOMB] += coulomb
    s[S_GENERATED] += generated
    s[S_UNEXPLAINED] += stored_energy(p, s) - before + viscous + coulomb - generated


@njit(types.void(_F, _F, _f8), inline=True)
def _observe(p: NDArray[np.float64], s: NDArray[np.float64], counts: float) -> None:
    """What `hapticd.servo.passivity` books for the period before a row."""
    before, now = (s[S_COUNTS] + 0.5) * p[P_RAW], (counts + 0.5) * p[P_RAW]
    work = s[S_CURRENT] * p[P_TORQUE_CONSTANT] * (now - before)
    s[S_PUT_OUT] += work
    s[S_OBSERVED] += work + _potential(p, now) - _potential(p, before)


@njit(types.void(_F, _F, _f8, _f8))
def _begin_anew(p: NDArray[np.float64], s: NDArray[np.float64], counts: float, now: float) -> None:
    """Place the model in the middle of the count that was read: at the first row, and where rows are lost.

    The velocity at the first row is the one that the state was made with.
    """
    before = stored_energy(p, s)
    dt = now - s[S_TIME]
    if s[S_SEEN] != 0.0:
        s[S_VELOCITY] = (counts - s[S_COUNTS]) * p[P_RAW] / dt if dt > 0.0 else 0.0
    s[S_POSITION] = (counts + 0.5) * p[P_RAW]
    s[S_TIME] = now
    s[S_TAIL] = s[S_HEAD]
    s[S_ACTING] = -1.0
    if s[S_RUNNING] != 0.0:
        s[S_UNEXPLAINED] += stored_energy(p, s) - before


@njit(types.void(_F, _F, _ROWS, _F2, _F2))
def replay(
    p: NDArray[np.float64], s: NDArray[np.float64], rows: Rows, out: NDArray[np.float64], places: NDArray[np.float64]
) -> None:
    """Take in the next rows.

    Args:
        p: (PARAMETERS,). s: (STATE_WORDS + …,) kept between calls.
        rows: (n,) of `record.ROW`, in order.
        out: (n, OUTPUTS) energies after each row, or (0, OUTPUTS).
        places: (n, PLACES) where the mass was while each row's force acted, or (0, PLACES); left as it is where that
            is not known to its end.
    """
    s[S_BEGAN], s[S_ACTING] = s[S_ROWS], -1.0
    for k in range(len(rows)):
        row = rows[k]
        late = max(row.wake_late_ns, 0) * 1e-9
        now = row.time_s + late
        dt = now - s[S_TIME]
        counts = float(row.encoder_counts) - p[P_ORIGIN]
        lost = row.tick != s[S_TICK] + 1.0 and row.flags & FLAG_MISSED_PERIOD == 0
        if s[S_SEEN] == 0.0 or lost or not dt > 0.0:
            _begin_anew(p, s, counts, now)
        else:
            _advance_through_commands(p, s, now, places)
            if row.flags & FLAG_MISSED_EXCHANGE == 0:
                _correct(p, s, counts, dt)
            if s[S_RUNNING] != 0.0 and s[S_EXCITED] == 0.0:
                _observe(p, s, counts)
        s[S_TICK], s[S_COUNTS], s[S_SEEN] = float(row.tick), counts, 1.0

        running = row.flags & FLAG_RUNNING != 0
        if running and s[S_RUNNING] == 0.0:
            s[S_VISCOUS : S_SETTINGS + 1] = 0.0
            s[S_PUT_OUT : S_OBSERVED + 1] = 0.0
            s[S_START] = stored_energy(p, s)
        s[S_RUNNING] = 1.0 if running else 0.0
        if running:
            s[S_STORED] = stored_energy(p, s)
        s[S_CURRENT], s[S_EXCITED] = row.current_command_A, float(row.flags & FLAG_EXCITATION)

        if s[S_HEAD] - s[S_TAIL] < QUEUE_LENGTH:
            slot = STATE_WORDS + 3 * (int(s[S_HEAD]) & _MASK)
            wait = max(late, p[P_WITHIN_PERIOD]) if running else late
            s[slot] = row.time_s + wait + p[P_LAG]
            s[slot + 1] = row.current_command_A * p[P_TORQUE_CONSTANT]
            s[slot + 2] = s[S_ROWS]
            s[S_HEAD] += 1.0
        s[S_ROWS] += 1.0
        if len(out) > 0:
            out[k, O_STORED], out[k, O_VISCOUS], out[k, O_COULOMB] = s[S_STORED], s[S_VISCOUS], s[S_COULOMB]
            out[k, O_GENERATED], out[k, O_UNEXPLAINED] = s[S_GENERATED], s[S_UNEXPLAINED] + s[S_SETTINGS]
            out[k, O_POSITION] = s[S_POSITION]
            out[k, O_PUT_OUT], out[k, O_OBSERVED] = s[S_PUT_OUT], s[S_OBSERVED]


_NO_OUTPUT = np.zeros((0, OUTPUTS))
_NO_PLACES = np.zeros((0, PLACES))


class EnergyEstimate:
    """Stored, dissipated and generated energy since the last start, through the model (`energy_replay`).

    Rows without ``FLAG_RUNNING`` keep the model on track and book nothing; each start begins anew. One thread calls
    `update` and `configure`; `status` may be called from another and is then at most one row's sums out of step.

    Args:
        config: the config in force. latency_s: the driver's declared latency.
        origin_counts: raw count of the spring's origin in force; None: the config's.
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
        self._parameters = replay_parameters(config, latency_s, origin_counts)
        self._state = replay_state()
        self._state[S_VELOCITY] = velocity

    def configure(self, config: Config, latency_s: float = 0.0, origin_counts: int | None = None) -> None:
        """Take changed settings into force from the next row on.

        What the spring holds more or less because of them is work of the settings, kept apart in ``settings_J``.
        """
        s, old = self._state, self._parameters
        new = replay_parameters(config, latency_s, origin_counts)
        before = stored_energy(old, s)
        shift = (old[P_ORIGIN] - new[P_ORIGIN]) * new[P_RAW]
        s[S_POSITION] += shift
        s[S_COUNTS] += old[P_ORIGIN] - new[P_ORIGIN]
        self._parameters = new
        if s[S_RUNNING]:
            s[S_STORED] = stored_energy(new, s)
            s[S_SETTINGS] += s[S_STORED] - before

    @property
    def origin_counts(self) -> int:
        """Raw count of the spring's origin in force."""
        return int(self._parameters[P_ORIGIN])

    def update(self, rows: Rows) -> None:
        """Take in the next rows, (n,) of `record.ROW` in order; n may be 0.

        Raises:
            TypeError: the rows are not of `record.ROW`.
        """
        check_rows(rows)
        replay(self._parameters, self._state, np.ascontiguousarray(rows), _NO_OUTPUT, _NO_PLACES)

    def status(self) -> dict[str, Any]:
        """Energies in J since the last start.

        Returns:
            ``stored_J`` now and ``stored_at_start_J``; since then ``dissipated_J``, ``generated_J``, ``settings_J``
            (changed settings) and ``unexplained_J``: a hand's work and the model's errors. They balance:
            stored = stored_at_start − dissipated + generated + settings + unexplained. ``estimate`` says what they are.
        """
        s = self._state
        return {
            "estimate": "through the model",
            "stored_J": float(s[S_STORED]),
            "stored_at_start_J": float(s[S_START]),
            "dissipated_J": float(s[S_VISCOUS] + s[S_COULOMB]),
            "generated_J": float(s[S_GENERATED]),
            "settings_J": float(s[S_SETTINGS]),
            "unexplained_J": float(s[S_UNEXPLAINED]),
        }

    def replayed(self, rows: Rows) -> tuple[FloatArray, FloatArray]:
        """`update`, with what it found in every row.

        Returns:
            (n, OUTPUTS) energies in J and positions, and (n, PLACES) places visited while each row's force acted, not
            a number where that is not known to its end.
        """
        check_rows(rows)
        out, places = np.zeros((rows.size, OUTPUTS)), np.full((rows.size, PLACES), np.nan)
        replay(self._parameters, self._state, np.ascontiguousarray(rows), out, places)
        return out, places
