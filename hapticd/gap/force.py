"""Score the model by force: the torque that is missing in the balance of forces along the recorded motion.

Feedback hides a missing force in the position, not in the balance

    residual = J a + b v + c sgn(v) − K_t i,                                     positive: pushes towards positive

which is formed on the smoothed motion and low-pass filtered as a whole (inverse dynamics; Gautier and Khalil 1990, with
the filtering of Janot, Vandanjon and Gautier 2014). What enters linearly is differentiated from the measured position,
so it goes through exactly one filter, the same as the force; sgn(v) and other products are formed unfiltered, then
filtered alike. Rows at rest, where stiction takes up any residual, are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from hapticd.gap.regression import Blocks, cross_validated
from hapticd.gap.smooth import (
    LowPass,
    Motion,
    acceleration_of,
    default_bandwidth,
    held_mean,
    motion_of,
    velocity_of,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.config import Config
    from hapticd.gap.data import Recording

    FloatArray = NDArray[np.float64]

_FOLDS = 5
_REST_CELLS = 1.5
_CELLS_OF_NOISE = 4.0
"""Where positions show no cells, noise takes their place: so many standard deviations for one."""
_MOVING = 0.95
"""A filtered row counts when at least this share of its weight lies on samples in motion."""


@dataclass(frozen=True)
class ForceSignals:
    """What the balance of forces of one recording is made of, unfiltered, n instants of a uniform grid.

    Attributes:
        motion: smoothed motion.
        velocity, acceleration: (n,) of the measured position, not smoothed: they go through the filter once.
        current: (n,) mean around each instant, in A, with the model's delay.
        current_rate: (n,) its derivative in A/s.
        direction: (n,) sign of the smoothed velocity; 0 at rest.
        moving: (n,) True where friction has its sliding value.
        low_pass: the filter of everything.
        rows: (m,) decimated instants that count, as indices into the filter's rows.
        time_s: (m,).
    """

    motion: Motion
    velocity: FloatArray
    acceleration: FloatArray
    current: FloatArray
    current_rate: FloatArray
    direction: FloatArray
    moving: NDArray[np.bool_]
    low_pass: LowPass
    rows: NDArray[np.int64]
    time_s: FloatArray

    def filtered(self, signal: FloatArray) -> FloatArray:
        """A signal (n,) through the filter, at the rows that count (m,)."""
        return self.low_pass(signal)[self.rows]


@dataclass(frozen=True)
class ForceScore:
    """Force side of one recording against one model; m rows.

    Attributes:
        name: recording.
        signals: what it was made of.
        time_s: (m,). residual: (m,) missing torque or force, N m or N.
        regressors: name → (m,) filtered, N m or N: ``inertia`` J a, ``viscous`` b v, ``coulomb`` c sgn(v), ``drive``
            K_t i; residual is the first three less the last.
        rms: of the residual. cv_rms: of the residual after the four base terms were fitted on other blocks of the record.
        bandwidth_hz: of the filter.
    """

    name: str
    signals: ForceSignals
    time_s: FloatArray
    residual: FloatArray
    regressors: dict[str, FloatArray] = field(repr=False)
    rms: float
    cv_rms: float
    bandwidth_hz: float


def force_signals(
    recording: Recording, model: Config, bandwidth_hz: float | None = None, delay_s: float | None = None
) -> ForceSignals:
    """Everything the balance of forces is made of.

    Args:
        recording: what was measured.
        model: nominal model; gives the inertia for the bandwidth, and the amplifier's delay.
        bandwidth_hz: of the filter; None: `smooth.default_bandwidth`.
        delay_s: from the stamp of a command to its effect; None: the amplifier's T_A.

    Raises:
        ValueError: the recording is too short for the filter, or never moves.
    """
    motion = motion_of(recording)
    delay = model.amplifier.delay if delay_s is None else delay_s
    current = held_mean(recording, recording.current, motion.time_s, delay)
    force_rms = model.amplifier.torque_constant * float(np.sqrt(np.mean(current**2)))
    bandwidth = bandwidth_hz or default_bandwidth(recording, model.plant.inertia, force_rms)
    low_pass = LowPass(bandwidth, motion.period_s)
    resting = _rests(motion, recording.resolution, round(1.0 / (bandwidth * motion.period_s)))
    moving = ~resting
    share = low_pass(moving.astype(np.float64)) if motion.time_s.size > 2 * low_pass.rows(0).start else np.zeros(0)
    rows = np.flatnonzero(share > _MOVING)
    if rows.size < 2 * _FOLDS:
        raise ValueError(f"{recording.name}: {rows.size} rows in motion are too few for a balance of forces")
    return ForceSignals(
        motion=motion,
        velocity=velocity_of(motion.measured, motion.period_s),
        acceleration=acceleration_of(motion.measured, motion.period_s),
        current=current,
        current_rate=velocity_of(current, motion.period_s),
        direction=np.where(moving, np.sign(motion.velocity), 0.0),
        moving=moving,
        low_pass=low_pass,
        rows=rows,
        time_s=motion.time_s[low_pass.rows(motion.time_s.size)][rows],
    )


def force_residual(
    recording: Recording, model: Config, bandwidth_hz: float | None = None, delay_s: float | None = None
) -> ForceScore:
    """The missing torque along a recording, the model held as it is. Arguments and errors: `force_signals`."""
    signals = force_signals(recording, model, bandwidth_hz, delay_s)
    regressors = base_regressors(signals, model)
    residual = regressors["inertia"] + regressors["viscous"] + regressors["coulomb"] - regressors["drive"]
    terms = np.stack([regressors[name] for name in ("inertia", "viscous", "coulomb")], axis=1)
    free = cross_validated(terms, regressors["drive"], Blocks.of(signals.time_s, _FOLDS))
    return ForceScore(
        name=recording.name,
        signals=signals,
        time_s=signals.time_s,
        residual=residual,
        regressors=regressors,
        rms=float(np.sqrt(np.mean(residual**2))),
        cv_rms=float(np.sqrt(np.mean(free**2))),
        bandwidth_hz=signals.low_pass.bandwidth_hz,
    )


def base_regressors(signals: ForceSignals, model: Config) -> dict[str, FloatArray]:
    """The four base terms of the balance, filtered (m,), N m or N; see `ForceScore`."""
    plant = model.plant
    return {
        "inertia": plant.inertia * signals.filtered(signals.acceleration),
        "viscous": plant.viscous * signals.filtered(signals.velocity),
        "coulomb": plant.coulomb * signals.filtered(signals.direction),
        "drive": model.amplifier.torque_constant * signals.filtered(signals.current),
    }


def _rests(motion: Motion, resolution: float, shortest: int) -> NDArray[np.bool_]:
    """Samples of stretches, ``shortest`` samples long or more, in which the measured position keeps to two cells.

    At rest, friction is whatever holds the shaft. Smoothing turns rest into a creep, so it is told by the samples. A
    reversal so slow that it looks like rest goes with it: the instant at which friction changes its sign is not known.
    """
    window = max(shortest, 3)
    wide = _REST_CELLS * (resolution or _CELLS_OF_NOISE * motion.noise)
    span = maximum_filter1d(motion.measured, window) - minimum_filter1d(motion.measured, window)
    return np.asarray(maximum_filter1d((span <= wide).astype(np.uint8), window) > 0)
