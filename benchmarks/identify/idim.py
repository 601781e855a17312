"""The peer: the inverse dynamic identification model with least squares (IDIM-LS), as for the EMPS benchmark.

Gautier 1997; Janot, Gautier and Brunot, "Data set and reference models of EMPS" (2019): positions through a zero-phase
Butterworth filter, central differences, the observation matrix and the torque through a parallel filter and decimation,
ordinary least squares with its textbook covariance. What such a user would know is granted: the delay is scanned, samples at
rest are left out, and the encoder's sign is the right one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, decimate, sosfiltfilt

Floats = NDArray[np.float64]

POSITION_HZ = 100.0
"""Corner of the position's filter."""
DECIMATION = 10
_DELAYS = np.arange(0.0, 4.0, 0.1)
"""Periods."""
_REST_COUNTS = 3.0
"""Speed in counts per filter time below which the shaft is taken to rest."""


def idim_ls(
    time_s: Floats, position: Floats, current: Floats, torque_constant: float, step: float
) -> tuple[Floats, Floats]:
    """Inertia, viscous, Coulomb friction, bias and delay, and half-widths of their 95 % intervals (0 for the delay).

    Args:
        time_s, position, current: (n,) a recording; s, rad, A. torque_constant: N m/A. step: one count, rad.
    """
    T = float(np.median(np.diff(time_s)))
    grid = np.arange(time_s[0], time_s[-1], T)
    sos = butter(4, POSITION_HZ, fs=1.0 / T, output="sos")
    x = sosfiltfilt(sos, np.interp(grid, time_s, position))
    v = np.gradient(x, T)
    rests = np.abs(v) < _REST_COUNTS * step * POSITION_HZ
    columns = np.stack([np.gradient(v, T), v, np.where(rests, 0.0, np.sign(v)), -np.ones_like(v)])
    A = decimate(columns, DECIMATION, axis=1).T
    moves = decimate(rests.astype(float), DECIMATION) < 0.02
    best: tuple[float, Floats, Floats, float] | None = None
    for periods in _DELAYS:
        held = np.interp(grid - (periods + 0.5) * T, time_s, torque_constant * current)
        y = decimate(held, DECIMATION)
        found, *_ = np.linalg.lstsq(A[moves], y[moves], rcond=None)
        left = y[moves] - A[moves] @ found
        power = float(left @ left)
        if best is None or power < best[0]:
            covariance = np.linalg.inv(A[moves].T @ A[moves]) * power / (moves.sum() - A.shape[1])
            reach = 1.96 * np.sqrt(np.diag(covariance))
            best = power, np.asarray(found, dtype=np.float64), reach, float(periods * T)
    assert best is not None
    return np.append(best[1], best[3]), np.append(best[2], 0.0)
