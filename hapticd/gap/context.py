"""What the builders of candidates look at: sizes of the recording, and the residual's linear response to forces.

A small extra force f moves the shaft of a window by the double integral of f/m, less what the fitted initial state
absorbs. Matching this response with the residual tells in one product how much an extra force of a given shape would
explain: good enough to choose orders, intervals and starting points, which the real prediction then judges.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.evidence import window_weight
from hapticd.gap.fit import evaluate, fit_states
from hapticd.gap.windows import thinned
from hapticd.plant.layout import word

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hapticd.gap.fit import Fit
    from hapticd.gap.hypothesis import Hypothesis, Term
    from hapticd.gap.predict import Segment

    Floats = NDArray[np.float64]
    Indices = NDArray[np.int64]

_STRUCTURED_PER_WINDOW = 4.0
"""Independent values that a smooth force error leaves in a window."""
_CHUNK = 64


@dataclass(frozen=True)
class Few:
    """Some of the windows, with their initial states, state gains, residuals, and the loss of the present model."""

    segments: Sequence[Segment]
    states: Sequence[Floats]
    gains: Sequence[Floats]
    residuals: Sequence[Floats]
    loss: float


def _stepped(
    segments: Sequence[Segment], hypothesis: Hypothesis, u: Floats, states: Sequence[Floats], gains: Sequence[Floats]
) -> tuple[float, list[Floats]]:
    """Loss of windows whose initial states follow to first order where that helps, and the residuals before they do."""
    solution, residuals = evaluate(segments, hypothesis, u, states)
    steps = [np.einsum("wil,wl->wi", gain, residual) for gain, residual in zip(gains, residuals, strict=True)]
    moved = [segment.stepped(state, step) for segment, state, step in zip(segments, states, steps, strict=True)]
    after, _ = evaluate(segments, hypothesis, u, moved)
    return float(np.minimum(solution.loss, after.loss).sum()), residuals


@dataclass(frozen=True)
class Context:
    """Present model, its residuals, and the recordings it was fitted to."""

    segments: Sequence[Segment]
    fit: Fit
    base: Floats
    """Device vector of the present model."""

    @property
    def inertia(self) -> float:
        """J or m of the model."""
        return float(self.base[word("inertia")])

    @property
    def viscous(self) -> float:
        """b of the model."""
        return float(self.base[word("viscous")])

    @property
    def coulomb(self) -> float:
        """c of the model."""
        return float(self.base[word("coulomb")])

    @property
    def torque_constant(self) -> float:
        """K_t of the model."""
        return float(self.base[word("torque_constant")])

    @property
    def is_linear(self) -> bool:
        """Whether positions are in metres."""
        return self.segments[0].recording.is_linear

    @property
    def period(self) -> float:
        """Sampling period [s]."""
        return self.segments[0].recording.period_s

    @property
    def duration(self) -> float:
        """Length of the longest recording [s]."""
        return max(s.recording.duration_s for s in self.segments)

    @property
    def window_s(self) -> float:
        """Length of a window [s]."""
        return self.segments[0].length_s

    @cached_property
    def resolution(self) -> float:
        """Quantisation or, where that is finer, the noise of a sample [rad or m]."""
        return max(max(s.resolution, float(np.median(s.sigma))) for s in self.segments)

    @cached_property
    def current(self) -> Floats:
        """Commanded current of all recordings, one after the other."""
        return np.asarray(np.concatenate([s.recording.current for s in self.segments]))

    @cached_property
    def speed(self) -> Floats:
        """Smoothed speed of all recordings."""
        return np.asarray(np.abs(np.concatenate([s.velocity for s in self.segments])))

    @cached_property
    def top_speed(self) -> float:
        """Speed that is hardly ever exceeded; never zero."""
        return max(float(np.quantile(self.speed, 0.995)), self.slowest_speed)

    @cached_property
    def slowest_speed(self) -> float:
        """Speed that a window just resolves: three resolutions in its length."""
        return 3.0 * self.resolution / self.window_s

    @property
    def peak_current(self) -> float:
        """Largest command [A]."""
        return float(np.abs(self.current).max())

    @property
    def lowest(self) -> float:
        """Smallest position."""
        return min(float(s.smooth.min()) for s in self.segments)

    @property
    def highest(self) -> float:
        """Largest position."""
        return max(float(s.smooth.max()) for s in self.segments)

    @property
    def span(self) -> float:
        """Range of positions."""
        return self.highest - self.lowest

    @cached_property
    def force_scale(self) -> float:
        """Size of the forces at work: friction or the typical motor force."""
        motor = self.torque_constant * float(np.sqrt(np.mean(self.current**2)))
        return max(self.coulomb, motor, 1e-300)

    @property
    def order_resolution(self) -> float:
        """Orders closer than this look alike over the range of the recording."""
        return 2.0 * np.pi / max(self.span, 1e-300) * 0.5

    @cached_property
    def window_time(self) -> Floats:
        """Start (w,) of every window in its recording [s]."""
        return np.concatenate([s.recording.time_s[s.windows.start] for s in self.segments])

    @cached_property
    def _response(self) -> list[Floats]:
        """(L, L): position after k ticks per force in tick j, of a mass with viscous friction."""
        result = []
        for segment in self.segments:
            period, length = segment.recording.period_s, segment.length
            decay = self.viscous / self.inertia * period
            after = np.arange(length)[:, None] - np.arange(length)[None, :]
            lag = np.maximum(after, 0) * period
            rate = self.viscous / self.inertia
            way = period * (-np.expm1(-rate * lag) / rate if decay > 1e-9 else lag) + 0.5 * period**2
            result.append(np.where(after >= 0, way, 0.0) / self.inertia)
        return result

    @cached_property
    def _weights(self) -> list[Floats]:
        parts = np.cumsum([s.count for s in self.segments])[:-1]
        return [np.asarray(w) for w in np.split(window_weight(self.fit.solution.mean_square), parts)]

    def _projected(self, number: int, columns: Floats, rows: slice | Indices) -> Floats:
        """What the initial state does not absorb of scaled columns (w, L, p)."""
        gain = self.fit.at.state_gain[number][rows]
        jacobian = self.fit.at.state_jacobian[number][rows]
        return np.asarray(columns - jacobian @ (gain @ columns))

    def _columns(self, number: int, forces: Sequence[Floats], rows: slice | Indices) -> Floats:
        """Projected responses (w, L, p) of some windows to forces (n,) that act while the shaft moves."""
        segment = self.segments[number]
        ticks = segment.windows.rows[rows] - 1
        moving = np.abs(segment.velocity[ticks]) > self.slowest_speed
        stacked = np.stack([force[ticks] * moving for force in forces], axis=-1)
        response = np.einsum("kj,wjp->wkp", self._response[number], stacked, optimize=True)
        return self._projected(number, response / segment.sigma[rows][:, None, None], rows)

    def normal_of_forces(self, forces: Sequence[Sequence[Floats]]) -> tuple[Floats, Floats]:
        """Normal equations (w, p, p) and (w, p) of extra forces; `forces[s][p]` is (n,) for recording s."""
        normals, rights = [], []
        for number, segment in enumerate(self.segments):
            for first in range(0, segment.count, _CHUNK):
                rows = slice(first, min(first + _CHUNK, segment.count))
                columns = self._columns(number, forces[number], rows)
                weight = self._weights[number][rows]
                residual = self.fit.residuals[number][rows]
                weighted = columns * weight[:, None, None]
                normals.append(np.swapaxes(weighted, 1, 2) @ columns)
                rights.append(np.einsum("wlp,wl->wp", weighted, residual))
        return np.concatenate(normals), np.concatenate(rights)

    @cached_property
    def _thinned(self) -> list[NDArray[np.bool_]]:
        squares = np.split(self.fit.solution.mean_square, np.cumsum([s.count for s in self.segments])[:-1])
        return [thinned(s.length_s, square) for s, square in zip(self.segments, squares, strict=True)]

    @cached_property
    def few(self) -> Few:
        """A third of the windows."""
        masks = self._thinned
        segments = [segment.chosen(mask) for segment, mask in zip(self.segments, masks, strict=True)]
        states = [state[mask] for state, mask in zip(self.fit.solution.states, masks, strict=True)]
        gains = [gain[mask] for gain, mask in zip(self.fit.at.state_gain, masks, strict=True)]
        solution = self.fit.solution
        loss, residuals = _stepped(segments, solution.hypothesis, solution.u, states, gains)
        return Few(segments, states, gains, residuals, loss)

    @property
    def samples_of_few(self) -> int:
        """Predicted samples of `few`."""
        return sum(segment.count * segment.length for segment in self.few.segments)

    def loss_with(self, term: Term, value: Floats) -> float:
        """Loss of a third of the windows with one more term at given coordinates; initial states follow to first order."""
        solution, few = self.fit.solution, self.few
        hypothesis, u = solution.hypothesis.with_term(term), np.concatenate([solution.u, value])
        if hypothesis.has_memory(u, 0) and not solution.hypothesis.has_memory(solution.u, 0):
            # What the windows inherit is new to all of them.
            return fit_states(few.segments, hypothesis, u, few.states, 2)[0].total
        return _stepped(few.segments, hypothesis, u, few.states, few.gains)[0]

    def gains_of_currents(self, changes: Sequence[Sequence[Floats]]) -> Floats:
        """Loss (p,) that changes of the motor current would save, by the linear response of a third of the windows.

        Each change counts in the size that saves most: where a shaft sticks, it answers less than linearly, and a large
        change would be ruled out although its shape is right.

        Args:
            changes: `changes[s][p]` is (n,) [A] for recording s.
        """
        explained, size = np.zeros(len(changes[0])), np.zeros(len(changes[0]))
        late = float(self.base[word("delay_s")] + self.base[word("transport_delay.t_d")])
        for number, segment in enumerate(self.segments):
            ticks = round(late / segment.recording.period_s)
            forces = [self.torque_constant * np.roll(change, ticks) for change in changes[number]]
            windows = np.flatnonzero(self._thinned[number])
            for rows in np.array_split(windows, max(len(windows) // _CHUNK, 1)):
                columns = self._columns(number, forces, rows)
                residual, weight = self.fit.residuals[number][rows], self._weights[number][rows]
                explained += weight @ np.einsum("wlp,wl->wp", columns, residual)
                size += weight @ np.einsum("wlp,wlp->wp", columns, columns)
        return np.maximum(explained, 0.0) ** 2 / np.maximum(size, 1e-300)

    def normal_of_harmonics(self, orders: Floats) -> tuple[Floats, Floats, float]:
        """Normal equations (2K, 2K), (2K,) of torques sin kθ, cos kθ, and the residual variance to judge gains by."""
        size = 2 * len(orders)
        gram, right = np.zeros((size, size)), np.zeros(size)
        squares = 0.0
        for number, segment in enumerate(self.segments):
            angles = segment.smooth[:, None] * orders[None, :]
            harmonics = np.empty((len(angles), size))
            harmonics[:, 0::2], harmonics[:, 1::2] = np.sin(angles), np.cos(angles)
            for first in range(0, segment.count, _CHUNK):
                rows = slice(first, min(first + _CHUNK, segment.count))
                ticks = segment.windows.rows[rows] - 1
                moving = np.abs(segment.velocity[ticks]) > self.slowest_speed
                shapes = harmonics[ticks] * moving[..., None]
                response = self._response[number] @ shapes
                columns = self._projected(number, response / segment.sigma[rows][:, None, None], rows)
                weight = np.sqrt(self._weights[number][rows])
                flat = (columns * weight[:, None, None]).reshape(-1, size)
                residual = (self.fit.residuals[number][rows] * weight[:, None]).ravel()
                gram += flat.T @ flat
                right += flat.T @ residual
                squares += float(residual @ residual) - len(residual)
        windows = sum(s.count for s in self.segments)
        return gram, right, 1.0 + max(squares, 0.0) / (_STRUCTURED_PER_WINDOW * windows)

    def grip_forces(self) -> list[list[Floats]]:
        """Forces of a unit grip inertia, damping, stiffness and pull: −ω̇, −ω, −θ, 1, of each recording."""
        result = []
        for segment in self.segments:
            acceleration = np.gradient(segment.velocity, segment.recording.time_s)
            result.append([-acceleration, -segment.velocity, -segment.smooth, np.ones_like(acceleration)])
        return result
