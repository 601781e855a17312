"""Fit the coordinates of a model to all windows at once, each window's initial state eliminated on the way.

Separable least squares (Golub and Pereyra 1973) in Gauss–Newton form: a window's residual e(u, x) depends on the shared
coordinates u and on its own initial state x = (θ₀, ω₀). With A = ∂e/∂x and B = ∂e/∂u, the state is projected out,

    H = Σ_w ρ_w (BᵀB − BᵀA (AᵀA)⁻¹ AᵀB),   g = Σ_w ρ_w (Bᵀe − BᵀA (AᵀA)⁻¹ Aᵀe),

with ρ_w the robust weight of the window, and the step of u is damped (Levenberg 1944, Marquardt 1963) until the total
loss falls. Derivatives are differences of whole predictions, so that a window in which the shaft sticks, slips or hits a
stop is differentiated as it is simulated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.evidence import window_loss, window_weight

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hapticd.gap.hypothesis import Hypothesis
    from hapticd.gap.predict import Segment

    Floats = NDArray[np.float64]

ITERATIONS = 25
_STATE_ITERATIONS = 6
_CONVERGED = 0.03
"""A step that lowers the loss by less than this is noise: a standard error of a coordinate changes it by 1."""
_WORSE = 1.0
_BAD = 3.0
_MENDING, _CHAINED = 4, 2
_STATE_RIDGE = 1e-6
_COORDINATE_RIDGE = 1e-9
_MOVED_LOW, _MOVED_HIGH = 0.02, 2.0
"""RMS change of the prediction, in standard deviations, that a difference step should cause."""


@dataclass(frozen=True)
class Solution:
    """A hypothesis at given coordinates, with the initial states and losses that belong to it."""

    hypothesis: Hypothesis
    u: Floats
    states: tuple[Floats, ...]
    mean_square: Floats
    """Mean squared residual (w,) of every window, in variances of one sample."""
    loss: Floats
    """Loss (w,) of every window, priors of latent quantities included."""

    @property
    def total(self) -> float:
        """Sum of all windows' losses."""
        return float(self.loss.sum())


@dataclass(frozen=True)
class Tangent:
    """Profiled normal equations of every window at a solution."""

    hessian: Floats
    """(w, P, P), robust weight included."""
    gradient: Floats
    """(w, P), of minus half the loss: the direction to go."""
    state_gain: tuple[Floats, ...]
    """(w, 2, L): what turns scaled residuals into the best step of the initial state."""
    state_slope: tuple[Floats, ...]
    """(w, 2, P): how the best initial state moves with the coordinates."""
    state_jacobian: tuple[Floats, ...]
    """(w, L, 2) in standard deviations."""


def evaluate(
    segments: Sequence[Segment], hypothesis: Hypothesis, u: Floats, states: Sequence[Floats]
) -> tuple[Solution, list[Floats]]:
    """Predict every window; return the solution and the scaled residuals (w, L) of each segment."""
    residuals, squares, losses = [], [], []
    for number, (segment, state) in enumerate(zip(segments, states, strict=True)):
        predicted = segment.predict(hypothesis.device(u, number), state)
        residual = segment.scaled(predicted)
        square = np.minimum(np.einsum("wl,wl->w", residual, residual) / segment.length, 1e12)
        square = np.where(np.isfinite(square), square, 1e12)
        residuals.append(residual)
        squares.append(square)
        losses.append(window_loss(square, segment.length) + hypothesis.latent_loss(number, segment))
    solution = Solution(hypothesis, u, tuple(states), np.concatenate(squares), np.concatenate(losses))
    return solution, residuals


def state_jacobian(
    segments: Sequence[Segment], hypothesis: Hypothesis, u: Floats, states: Sequence[Floats], residuals: list[Floats]
) -> list[Floats]:
    """∂prediction/∂(θ₀, ω₀) of every window, (w, L, 2), in standard deviations per unit."""
    result = []
    for number, (segment, state, residual) in enumerate(zip(segments, states, residuals, strict=True)):
        jacobian = np.empty((*residual.shape, 2))
        for word, step in enumerate((segment.position_step, segment.velocity_step)):
            moved = segment.nudged(state, word, step)
            predicted = segment.predict(hypothesis.device(u, number), moved)
            jacobian[..., word] = (residual - segment.scaled(predicted)) / step
        result.append(np.nan_to_num(jacobian, posinf=0.0, neginf=0.0))
    return result


def _state_gain(segment: Segment, jacobian: Floats, is_position_alone: bool = False) -> Floats:
    """(AᵀA)⁻¹Aᵀ of every window, with a ridge that keeps a state which no sample feels where it is."""
    normal = np.einsum("wli,wlj->wij", jacobian, jacobian)
    if is_position_alone:
        normal[:, 0, 1] = normal[:, 1, 0] = 0.0
    scale = np.array([segment.position_step, segment.velocity_step]) ** -2.0
    normal += np.diag(_STATE_RIDGE * segment.length * scale)
    return np.asarray(np.linalg.solve(normal, np.swapaxes(jacobian, 1, 2)))


def _better_states(
    segments: Sequence[Segment], solution: Solution, trial: Solution, residuals: list[Floats], new: list[Floats]
) -> tuple[Solution, list[Floats]]:
    """Window by window, whichever of two initial states predicts better."""
    take = trial.loss < solution.loss
    states, kept, offset = [], [], 0
    for segment, old_state, new_state, old, fresh in zip(
        segments, solution.states, trial.states, residuals, new, strict=True
    ):
        mask = take[offset : offset + len(old)][:, None]
        states.append(np.where(mask, new_state, old_state))
        kept.append(np.where(mask, fresh, old))
        offset += segment.count
    merged = replace(
        solution,
        states=tuple(states),
        mean_square=np.where(take, trial.mean_square, solution.mean_square),
        loss=np.where(take, trial.loss, solution.loss),
    )
    return merged, kept


def fit_states(
    segments: Sequence[Segment],
    hypothesis: Hypothesis,
    u: Floats,
    states: Sequence[Floats],
    iterations: int = _STATE_ITERATIONS,
) -> tuple[Solution, list[Floats]]:
    """Best initial state of every window at fixed coordinates, by Gauss–Newton, with a smaller step where that fails.

    The position is stepped alone too: what the velocity of a shaft that is about to slip does is known to no first order.
    """
    if hypothesis.has_memory(u, 0):
        return _fit_chained(segments, hypothesis, u, [states], iterations)
    solution, residuals = evaluate(segments, hypothesis, u, states)
    for _ in range(iterations):
        jacobians = state_jacobian(segments, hypothesis, u, solution.states, residuals)
        before = solution.total
        for shares in ((1.0, 1.0), (0.3, 0.3), (1.0, 0.0)):
            trial_states = []
            for segment, state, jacobian, residual in zip(segments, solution.states, jacobians, residuals, strict=True):
                step = np.einsum("wil,wl->wi", _state_gain(segment, jacobian, shares[1] == 0.0), residual)
                trial_states.append(segment.stepped(state, np.array(shares) * step))
            trial, fresh = evaluate(segments, hypothesis, u, trial_states)
            solution, residuals = _better_states(segments, solution, trial, residuals, fresh)
        if before - solution.total < _CONVERGED * len(solution.loss) ** 0.5:
            break
    return solution, residuals


def _fit_chained(
    segments: Sequence[Segment], hypothesis: Hypothesis, u: Floats, tries: Sequence[Sequence[Floats]], iterations: int
) -> tuple[Solution, list[Floats]]:
    """Best initial states of a device with a memory, from several; rest and the smoothed motion are tried too."""
    found = []
    for number, segment in enumerate(segments):
        own = [states[number] for states in tries]
        rest = [segment.at_rest(own[0]), segment.first_states()]
        found.append(segment.inherited(hypothesis.device(u, number), own + rest, iterations))
    return evaluate(segments, hypothesis, u, found)


def tangent(
    segments: Sequence[Segment], solution: Solution, residuals: list[Floats], steps: Floats
) -> tuple[Tangent, Floats]:
    """Profiled normal equations at a solution; also returns difference steps adapted to this place."""
    hypothesis, u = solution.hypothesis, solution.u
    jacobians = state_jacobian(segments, hypothesis, u, solution.states, residuals)
    gains = [_state_gain(s, j) for s, j in zip(segments, jacobians, strict=True)]
    steps = steps.copy()
    columns: list[list[Floats]] = [[] for _ in segments]
    for k in range(len(u)):
        for _ in range(4):
            moved_u, step = hypothesis.nudged(u, k, steps[k])
            moved = []
            for number, (segment, state, residual) in enumerate(zip(segments, solution.states, residuals, strict=True)):
                predicted = segment.predict(hypothesis.device(moved_u, number), state)
                moved.append(np.nan_to_num((residual - segment.scaled(predicted)) / step, posinf=0.0, neginf=0.0))
            size = abs(step) * float(np.sqrt(np.mean([np.mean(column**2) for column in moved])))
            if _MOVED_LOW <= size <= _MOVED_HIGH or size == 0.0:
                break
            factor = float(np.clip(0.3 / size, 1e-3, 1e3))
            if abs(factor * steps[k]) > hypothesis.largest_step(k) or abs(factor * steps[k]) < 1e-12:
                break
            steps[k] *= factor
        for number, column in enumerate(moved):
            columns[number].append(column)
    hessians, gradients, slopes, offset = [], [], [], 0
    for segment, jacobian, gain, residual, column_list in zip(
        segments, jacobians, gains, residuals, columns, strict=True
    ):
        b = np.stack(column_list, axis=-1) if column_list else np.zeros((*residual.shape, 0))
        slope = np.einsum("wil,wlp->wip", gain, b)
        projected = b - np.einsum("wli,wip->wlp", jacobian, slope)
        weight = window_weight(solution.mean_square[offset : offset + segment.count])
        offset += segment.count
        hessians.append(weight[:, None, None] * np.einsum("wlp,wlq->wpq", projected, projected))
        gradients.append(weight[:, None] * np.einsum("wlp,wl->wp", projected, residual))
        slopes.append(slope)
    result = Tangent(np.concatenate(hessians), np.concatenate(gradients), tuple(gains), tuple(slopes), tuple(jacobians))
    return result, steps


def moved_states(
    segments: Sequence[Segment], solution: Solution, residuals: list[Floats], at: Tangent, step: Floats
) -> list[Floats]:
    """Initial states that go with a step of the coordinates, to first order."""
    moved = []
    for segment, state, residual, gain, slope in zip(
        segments, solution.states, residuals, at.state_gain, at.state_slope, strict=True
    ):
        moved.append(segment.stepped(state, np.einsum("wil,wl->wi", gain, residual) - slope @ step))
    return moved


def settled(
    segments: Sequence[Segment],
    hypothesis: Hypothesis,
    u: Floats,
    states: Sequence[Floats],
    before: Solution,
    at: Tangent,
) -> tuple[Solution, list[Floats]]:
    """Evaluate at new coordinates, with the best initial states that can be had cheaply.

    To first order the states move with the coordinates (`states`); where a shaft begins to slip or to stick that is wrong
    by orders of magnitude, so each window may keep its state. Windows that predict worse than before are fitted anew.
    """
    if hypothesis.has_memory(u, 0):
        return _fit_chained(segments, hypothesis, u, [states, before.states], _CHAINED)
    solution, residuals = evaluate(segments, hypothesis, u, states)
    kept, fresh = evaluate(segments, hypothesis, u, before.states)
    solution, residuals = _better_states(segments, solution, kept, residuals, fresh)
    again = [
        segment.stepped(state, np.einsum("wil,wl->wi", gain, residual))
        for segment, state, gain, residual in zip(segments, solution.states, at.state_gain, residuals, strict=True)
    ]
    trial, fresh = evaluate(segments, hypothesis, u, again)
    solution, residuals = _better_states(segments, solution, trial, residuals, fresh)
    return _mended(segments, solution, residuals, solution.loss > before.loss + _WORSE)


def _mended(
    segments: Sequence[Segment], solution: Solution, residuals: list[Floats], worse: NDArray[np.bool_]
) -> tuple[Solution, list[Floats]]:
    """Fit the initial states of some windows anew, starting from rest too."""
    if not worse.any() or solution.hypothesis.has_memory(solution.u, 0):
        return solution, residuals
    parts = np.split(worse, np.cumsum([s.count for s in segments])[:-1])
    few = [segment.chosen(part) for segment, part in zip(segments, parts, strict=True)]
    states = [state[part] for state, part in zip(solution.states, parts, strict=True)]
    fitted, _ = fit_states(few, solution.hypothesis, solution.u, states, _MENDING)
    for others in ([s.at_rest(x) for s, x in zip(few, states, strict=True)], [s.first_states() for s in few]):
        other, fresh = fit_states(few, solution.hypothesis, solution.u, others, _MENDING)
        fitted, _ = _better_states(few, fitted, other, fresh, fresh)
    merged = []
    for state, part, better in zip(solution.states, parts, fitted.states, strict=True):
        new = state.copy()
        new[part] = better
        merged.append(new)
    trial, fresh = evaluate(segments, solution.hypothesis, solution.u, merged)
    return _better_states(segments, solution, trial, residuals, fresh)


def restarted(
    segments: Sequence[Segment], solution: Solution, residuals: list[Floats]
) -> tuple[Solution, list[Floats]]:
    """Fit badly predicted windows anew from other initial states: one may be stuck where a wrong model put it."""
    return _mended(segments, solution, residuals, solution.mean_square > _BAD)


def damped_step(hessian: Floats, gradient: Floats, damping: float) -> Floats:
    """(H + λ·diag H)⁻¹ g, with coordinates that nothing depends on left where they are."""
    diagonal = np.diag(hessian).copy()
    diagonal[diagonal <= 0.0] = 1.0
    scale = 1.0 / np.sqrt(diagonal)
    normal = hessian * scale[:, None] * scale[None, :] + np.diag(np.full(len(diagonal), damping + _COORDINATE_RIDGE))
    return np.asarray(scale * np.linalg.solve(normal, scale * gradient))


@dataclass(frozen=True)
class Fit:
    """A converged solution and its tangent, from which cross-validation and intervals are formed."""

    solution: Solution
    residuals: list[Floats]
    at: Tangent


def fit(
    segments: Sequence[Segment],
    hypothesis: Hypothesis,
    u: Floats,
    states: Sequence[Floats],
    iterations: int = ITERATIONS,
    patience: float = 0.0,
) -> Fit:
    """Fit all coordinates from `u`; every accepted step lowers the total robust loss.

    Args:
        segments: windows.
        hypothesis: what is fitted.
        u: start.
        states: initial states to start from, one array a segment.
        iterations: accepted steps at the most.
        patience: a step that gains less than this share of what has been gained is the last one.
    """
    steps = hypothesis.steps(u)
    solution, residuals = fit_states(segments, hypothesis, u, states, iterations=2)
    at, steps = tangent(segments, solution, residuals, steps)
    damping, first = 1e-3, solution.total
    for _ in range(iterations if len(u) else 0):
        hessian, gradient = at.hessian.sum(0), at.gradient.sum(0)
        improved = 0.0
        for _ in range(7):
            target = hypothesis.bounded(solution.u + damped_step(hessian, gradient, damping))
            if abs(float(gradient @ (target - solution.u))) < _CONVERGED:
                break
            states_there = moved_states(segments, solution, residuals, at, target - solution.u)
            trial, fresh = settled(segments, hypothesis, target, states_there, solution, at)
            improved = solution.total - trial.total
            if improved > 0.0:
                solution, residuals = trial, fresh
                damping = max(damping * 0.1, 1e-9)
                break
            damping = max(damping * 8.0, 1e-6)
        if improved <= 0.0:
            break
        at, steps = tangent(segments, solution, residuals, steps)
        if improved < max(_CONVERGED, patience * (first - solution.total)):
            break
    solution, residuals = restarted(segments, solution, residuals)
    at, _ = tangent(segments, solution, residuals, steps)
    return Fit(solution, residuals, at)
