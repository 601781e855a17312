"""Predict the windows of one recording with the kernels of the plant, from the recorded current.

A window starts from position and velocity of its own. What else a device remembers (a bristle, a load behind play or a
spring) is handed on from the end of the window before, so that it is a consequence of the model and not a free state.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtri

from hapticd.gap.chained import fit_chain
from hapticd.gap.hypothesis import has_memory
from hapticd.gap.initial import smooth_motion
from hapticd.gap.windows import Windows
from hapticd.plant.chain import simulate_chain
from hapticd.plant.electrical import electrical
from hapticd.plant.layout import LOAD_OMEGA, LOAD_THETA, OMEGA, STATE, THETA, WORDS, word
from hapticd.plant.numeric import simulate_windows_serial, substeps_for

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hapticd.gap.data import Recording
    from hapticd.gap.hypothesis import Device

    Floats = NDArray[np.float64]

_WORDS = ((THETA, LOAD_THETA), (OMEGA, LOAD_OMEGA))
_ELECTRICAL = [
    index
    for index, name in enumerate(WORDS)
    if name == "delay_s"
    or name.split(".")[0] in ("transport_delay", "amplifier_lag", "current_saturation", "dac_quantization")
]
_DRIVES_KEPT = 6
_ON, _OFF = word("hand_impedance.on_s"), word("hand_impedance.off_s")
_DELAY, _TRANSPORT_DELAY = word("delay_s"), word("transport_delay.t_d")
_NEVER = 1e9
_AT_REST = 0.3
"""Cells that a shaft predicted to be at rest moves in a window at the most."""
_GOOD = 2.0
"""Variances of a sample below which a window's mean squared error asks for no other initial state."""
_NO_GRID = 1e-12
"""Cells of a recording that shows no quantisation, as a share of its range."""


@dataclass(frozen=True)
class _Drive:
    """Motor current (n, substeps) in the rows that begin at `time_s`: those of the recording, or two for each."""

    time_s: Floats
    current: Floats


def split_at_switching(time_s: Floats, delay_s: float) -> Floats:
    """Times (2n,) of the rows and, in each row, of the instant at which the current switches.

    The mean of the current over a tick gives the right velocity but a wrong position, by up to Δi·K_t/m·T²/8 for a step
    Δi: enough to look like a delay of some µs and to shift every other parameter. So a tick is cut where a delayed command
    takes effect, or in the middle when none does.
    """
    ends = np.append(time_s[1:], 2.0 * time_s[-1] - time_s[-2])
    switching = np.append(time_s, np.inf) + delay_s
    instant = switching[np.searchsorted(switching, time_s, side="right")]
    slack = 1e-6 * (ends - time_s)
    inside = (instant > time_s + slack) & (instant < ends - slack)
    return np.stack([time_s, np.where(inside, instant, 0.5 * (time_s + ends))], axis=1).ravel()


@dataclass
class Segment:
    """Windows of one recording, their samples, and what one sample's error is worth."""

    recording: Recording
    windows: Windows
    smooth: Floats
    """Smoothed position (n,)."""
    velocity: Floats
    """Smoothed velocity (n,)."""
    resolution: float
    sigma: Floats
    """Standard deviation (w,) of one position sample."""
    extra_sigma: Floats
    """Part (w,) of it that is not quantisation."""
    observed: Floats
    """Recorded positions (w, L) of the predicted ticks."""
    _drives: dict[tuple[int, bytes, int], _Drive] = field(default_factory=dict, repr=False)

    @property
    def count(self) -> int:
        """Number of windows."""
        return len(self.windows.start)

    @property
    def length(self) -> int:
        """Predicted samples of a window."""
        return self.windows.length

    @property
    def length_s(self) -> float:
        """Length of a window [s]."""
        return self.length * self.recording.period_s

    @cached_property
    def position_step(self) -> float:
        """Difference step of an initial position: about the noise of a sample."""
        return 0.3 * self._typical_sigma

    @cached_property
    def velocity_step(self) -> float:
        """Difference step of an initial velocity: moves the end of the window by about the noise of a sample."""
        return self._typical_sigma / self.length_s

    @cached_property
    def _typical_sigma(self) -> float:
        # Of a selection nothing may be left of one recording; any step serves no windows.
        return float(np.median(self.sigma)) if self.count else 1.0

    def chosen(self, mask: NDArray[np.bool_]) -> Segment:
        """The same recording with some of the windows."""
        windows = Windows(self.windows.start[mask], self.windows.length, self.windows.block[mask])
        return replace(
            self,
            windows=windows,
            sigma=self.sigma[mask],
            extra_sigma=self.extra_sigma[mask],
            observed=self.observed[mask],
        )

    def seeing(self, observed: Floats) -> Segment:
        """The same windows with other measurements."""
        return replace(self, observed=observed)

    def within_cell(self, predicted: Floats) -> Floats:
        """A predicted motion (w, L) with shafts at rest put where their counts say: at an edge, when two counts alternate.

        A fit of least squares puts such a shaft at the mean of the counts, from where noise would hardly reach the edge.
        The share of the upper count says how far from the edge it is, in standard deviations of the noise.
        """
        low = self.observed.min(axis=1)
        upper = self.observed > low[:, None] + 0.5 * self.resolution
        share = np.clip(upper.mean(axis=1), 0.5 / self.length, 1.0 - 0.5 / self.length)
        at_rest = np.ptp(predicted, axis=1) < _AT_REST * self.resolution
        alternates = (np.ptp(self.observed, axis=1) < 1.5 * self.resolution) & upper.any(axis=1)
        place = low + 0.5 * self.resolution + self.extra_sigma * ndtri(share)
        return np.where(
            (at_rest & alternates)[:, None], predicted + (place - predicted.mean(axis=1))[:, None], predicted
        )

    def remeasured(self, predicted: Floats, rng: np.random.Generator) -> Floats:
        """What would be recorded of a predicted motion (w, L): with noise, on the recording's own grid.

        The grid's phase matters: a virtual spring holds a shaft at the very edge of a cell, where noise alone makes the
        count jump to and fro.
        """
        noisy = predicted + self.extra_sigma[:, None] * rng.standard_normal(predicted.shape)
        centre = self.recording.position[0]
        return np.asarray(centre + np.rint((noisy - centre) / self.resolution) * self.resolution)

    def first_states(self) -> Floats:
        """Initial states (w, STATE) from the smoothed motion."""
        states = np.zeros((self.count, STATE))
        start = self.windows.start
        states[:, [THETA, LOAD_THETA]] = self.smooth[start][:, None]
        states[:, [OMEGA, LOAD_OMEGA]] = self.velocity[start][:, None]
        return states

    def predict(self, device: Device, state: Floats) -> Floats:
        """Predicted measurements (w, L) from initial states (w, STATE)."""
        vector = device.vector
        # Powers of two, so that a difference step seldom changes the number.
        substeps = 1 << (substeps_for(vector, self.recording.period_s) - 1).bit_length()
        drive = self._drive(device, substeps)
        parts = len(drive.time_s) // self.recording.rows
        start, length = parts * self.windows.start, parts * self.length
        predicted = np.empty((self.count, length))
        state, end = np.ascontiguousarray(state), np.empty_like(state)
        if device.grips is not None and not has_memory(vector):
            self._predict_gripped(vector, device.grips, drive, start, state, predicted)
        else:
            simulate = simulate_chain if has_memory(vector) else simulate_windows_serial
            simulate(vector, drive.time_s, drive.current, start, length, state, predicted, end)
        return np.ascontiguousarray(predicted[:, parts - 1 :: parts])

    def inherited(self, device: Device, tries: Sequence[Floats], iterations: int) -> Floats:
        """Initial states (w, STATE) of a device with a memory, each fitted before the next window takes it over.

        Args:
            device: whose memory is handed on.
            tries: initial states to start from, each (w, STATE).
            iterations: of each window.
        """
        substeps = 1 << (substeps_for(device.vector, self.recording.period_s) - 1).bit_length()
        drive = self._drive(device, substeps)
        parts = len(drive.time_s) // self.recording.rows
        found = np.empty((self.count, STATE))
        fit_chain(
            device.vector,
            drive.time_s,
            drive.current,
            parts * self.windows.start,
            parts,
            np.stack(tries),
            self.observed,
            self.position_step,
            self.velocity_step,
            _GOOD * self._typical_sigma**2,
            iterations,
            found,
        )
        return found

    def _predict_gripped(
        self,
        vector: Floats,
        grips: Sequence[tuple[float, float]],
        drive: _Drive,
        start: NDArray[np.int64],
        state: Floats,
        predicted: Floats,
    ) -> None:
        """Predict each window with the grip that is next to it."""
        middle = 0.5 * (drive.time_s[start] + drive.time_s[start + predicted.shape[1]])
        distance = np.array([np.maximum(on - middle, middle - off) for on, off in grips] or [np.ones(self.count)])
        nearest = np.argmin(distance, axis=0)
        for number, (on, off) in enumerate(grips or [(_NEVER, _NEVER)]):
            mine = np.flatnonzero(nearest == number)
            held = vector.copy()
            held[_ON], held[_OFF] = on, off
            part, end = np.empty((len(mine), predicted.shape[1])), np.empty((len(mine), STATE))
            simulate_windows_serial(
                held, drive.time_s, drive.current, start[mine], predicted.shape[1], state[mine], part, end
            )
            predicted[mine] = part

    def _drive(self, device: Device, substeps: int) -> _Drive:
        """Motor current over the recording; kept, because most devices of a fit differ in mechanics only."""
        lost = device.lost if device.lost is not None else np.zeros(self.recording.rows, dtype=np.uint8)
        key = (substeps, device.vector[_ELECTRICAL].tobytes(), hash(lost.tobytes()))
        known = self._drives.get(key)
        if known is None:
            time_s, command = self.recording.time_s, self.recording.current
            delay = float(device.vector[_DELAY] + device.vector[_TRANSPORT_DELAY])
            if delay > 0.0:
                time_s, command, lost = split_at_switching(time_s, delay), np.repeat(command, 2), np.repeat(lost, 2)
            current = np.empty((len(time_s), substeps))
            electrical(device.vector, time_s, command, lost, substeps, current)
            known = _Drive(time_s, current)
            if len(self._drives) >= _DRIVES_KEPT:
                self._drives.clear()
            self._drives[key] = known
        return known

    def scaled(self, predicted: Floats) -> Floats:
        """Residuals (w, L) in standard deviations."""
        return np.asarray((self.observed - predicted) / self.sigma[:, None])

    def nudged(self, state: Floats, part: int, step: float) -> Floats:
        """States with the initial position (0) or velocity (1) of shaft and load moved by a step."""
        moved = state.copy()
        for index in _WORDS[part]:
            moved[:, index] += step
        return moved

    def stepped(self, state: Floats, step: Floats) -> Floats:
        """States moved by a step (w, 2) of position and velocity."""
        moved = state.copy()
        for part in (0, 1):
            for index in _WORDS[part]:
                moved[:, index] += step[:, part]
        return moved

    def at_rest(self, state: Floats) -> Floats:
        """States without velocity, at the mean of what the window shows."""
        still = state.copy()
        still[:, [THETA, LOAD_THETA]] = self.observed.mean(axis=1)[:, None]
        still[:, [OMEGA, LOAD_OMEGA]] = 0.0
        return still

    def per_window(self, ticks: Floats) -> Floats:
        """Sum of values (n,) over the ticks that drive each window."""
        return np.asarray(ticks[self.windows.rows - 1].sum(axis=1), dtype=np.float64)


def segment_of(recording: Recording, windows: Windows, sigma: float) -> Segment:
    """A segment whose samples all have the same noise; `Segment.sigma` is refined by the caller."""
    smooth, velocity = smooth_motion(recording.position, recording.period_s)
    span = float(np.ptp(recording.position))
    resolution = recording.resolution if recording.resolution > 0.0 else _NO_GRID * max(span, 1e-300)
    count = len(windows.start)
    observed = recording.position[windows.rows]
    return Segment(recording, windows, smooth, velocity, resolution, np.full(count, sigma), np.zeros(count), observed)
