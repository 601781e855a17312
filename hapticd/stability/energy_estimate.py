"""Energies of the running loop since its start, estimated through the model row by row in bounded memory."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.record.schema import Rows, check_rows
from hapticd.stability import energy_replay as e
from hapticd.stability.storage import FloatArray

if TYPE_CHECKING:
    from hapticd.config import Config

_NO_OUTPUT = np.zeros((0, e.OUTPUTS))
_NO_PLACES = np.zeros((0, e.PLACES))


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
        self._parameters = e.replay_parameters(config, latency_s, origin_counts)
        self._state = e.replay_state()
        self._state[e.S_VELOCITY] = velocity

    def configure(self, config: Config, latency_s: float = 0.0, origin_counts: int | None = None) -> None:
        """Take changed settings into force from the next row on.

        What the spring holds more or less because of them is work of the settings, kept apart in ``settings_J``.
        """
        s, old = self._state, self._parameters
        new = e.replay_parameters(config, latency_s, origin_counts)
        before = e.stored_energy(old, s)
        shift = (old[e.P_ORIGIN] - new[e.P_ORIGIN]) * new[e.P_RAW]
        s[e.S_POSITION] += shift
        s[e.S_COUNTS] += old[e.P_ORIGIN] - new[e.P_ORIGIN]
        self._parameters = new
        if s[e.S_RUNNING]:
            s[e.S_STORED] = e.stored_energy(new, s)
            s[e.S_SETTINGS] += s[e.S_STORED] - before

    @property
    def origin_counts(self) -> int:
        """Raw count of the spring's origin in force."""
        return int(self._parameters[e.P_ORIGIN])

    def update(self, rows: Rows) -> None:
        """Take in the next rows, (n,) of `record.ROW` in order; n may be 0.

        Raises:
            TypeError: the rows are not of `record.ROW`.
        """
        check_rows(rows)
        e.replay(self._parameters, self._state, np.ascontiguousarray(rows), _NO_OUTPUT, _NO_PLACES)

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
            "stored_J": float(s[e.S_STORED]),
            "stored_at_start_J": float(s[e.S_START]),
            "dissipated_J": float(s[e.S_VISCOUS] + s[e.S_COULOMB]),
            "generated_J": float(s[e.S_GENERATED]),
            "settings_J": float(s[e.S_SETTINGS]),
            "unexplained_J": float(s[e.S_UNEXPLAINED]),
        }

    def replayed(self, rows: Rows) -> tuple[FloatArray, FloatArray]:
        """`update`, with what it found in every row.

        Returns:
            (n, OUTPUTS) energies in J and positions, and (n, PLACES) places visited while each row's force acted, not
            a number where that is not known to its end.
        """
        check_rows(rows)
        out, places = np.zeros((rows.size, e.OUTPUTS)), np.full((rows.size, e.PLACES), np.nan)
        e.replay(self._parameters, self._state, np.ascontiguousarray(rows), out, places)
        return out, places
