"""The usual way to judge a model of measured motion: filter position and force alike, differentiate, regress.

A fourth-order Butterworth filter of 100 Hz, run forwards and backwards, on position, force and the sign of the velocity;
central differences; every tenth sample, through the filter that `scipy.signal.decimate` brings. The figures published for
EMPS, and those that this recipe gave for richer models, are residual forces found in this way.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, decimate, sosfiltfilt

from hapticd.gap.recording import Recording

Floats = NDArray[np.float64]

CORNER_HZ = 100.0
ORDER = 4
EVERY = 10
_ENDS = 20
"""Samples at each end that the filters' start and end reach, after decimation."""


class Balance:
    """Filtered motion and force of a recording, on every tenth sample.

    Args:
        recording: evenly sampled.
        force_per_current: N/A of the recorded current.
    """

    def __init__(self, recording: Recording, force_per_current: float) -> None:
        self._sections = butter(ORDER, CORNER_HZ, fs=1.0 / recording.period_s, output="sos")
        position = self._smooth(recording.position)
        velocity = np.gradient(position, recording.period_s)
        self._columns = {
            "inertia": np.gradient(velocity, recording.period_s),
            "viscous": velocity,
            # Taken pointwise on the filtered velocity, the sign would be sharper than the force it is compared with.
            "coulomb": self._smooth(np.sign(velocity)),
            "offset": np.ones_like(velocity),
            "asymmetric viscous": np.abs(velocity),
        }
        self._force = self._smooth(force_per_current * recording.current)

    def _smooth(self, signal: Floats) -> Floats:
        return np.asarray(sosfiltfilt(self._sections, signal))

    def residual_rms(self, *more: str) -> float:
        """What the rigid model with these columns besides leaves of the force, RMS; all coefficients fitted."""
        names = ("inertia", "viscous", "coulomb", *more)
        columns = np.column_stack([_thinned(self._columns[name]) for name in names])
        force = _thinned(self._force)
        left = force - columns @ np.linalg.lstsq(columns, force, rcond=None)[0]
        return float(np.sqrt(np.mean(left**2)))

    def left_by(self, coefficients: Mapping[str, float]) -> float:
        """What a model with these coefficients, none of them fitted here, leaves of the force, RMS."""
        force = self._force - sum(value * self._columns[name] for name, value in coefficients.items())
        return float(np.sqrt(np.mean(_thinned(force) ** 2)))


def _thinned(signal: Floats) -> Floats:
    return np.asarray(decimate(signal, EVERY))[_ENDS:-_ENDS]
