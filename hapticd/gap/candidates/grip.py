"""A hand on the knob: inertia, damper and spring in parallel, for parts of the recording that must be found first.

Where it is held, four constant coefficients (m, b, k, k·rest) explain the residual; elsewhere none. The coefficients come
from the interval in which they explain most; then a path through two states, held and free, that pays for every change
(Viterbi 1967) and coefficients fitted to the windows held take turns.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hapticd.gap.candidates.build import Scalar, scalar_term
from hapticd.gap.fit import fit, fit_states
from hapticd.gap.hypothesis import Term
from hapticd.plant.effects.layout import word

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from hapticd.gap.context import Context

    Floats = NDArray[np.float64]
    Interval = tuple[float, float]

_EDGES = 60
_RIDGE = 1e-9
_TURNS = 4
_CHANGE = 20.0
"""Loss that taking hold or letting go must save."""
_FOREVER = 1e9
_ALWAYS = 0.95
"""Share of the windows beyond which a hand holds all the time but for windows that went the other way by chance."""
_LOOK = 6
"""Iterations of the fit whose predictions say where the hand holds."""


def _solved(normal: Floats, right: Floats) -> Floats:
    """Coefficients (p, 4) of normal equations (p, 4, 4), scaled so that units do not matter."""
    scale = np.sqrt(np.maximum(np.einsum("pii->pi", normal), 1e-300))
    scaled = normal / (scale[:, :, None] * scale[:, None, :]) + _RIDGE * np.eye(4)
    return np.asarray(np.linalg.solve(scaled, (right / scale)[..., None])[..., 0] / scale)


def _best_interval(hessian: Floats, gradient: Floats) -> Floats:
    """Coefficients of the interval of windows in which they explain most."""
    edges = np.unique(np.linspace(0, len(hessian), _EDGES + 1).astype(int))
    h = np.concatenate([np.zeros((1, 4, 4)), np.cumsum(hessian, axis=0)])[edges]
    g = np.concatenate([np.zeros((1, 4)), np.cumsum(gradient, axis=0)])[edges]
    first, last = np.triu_indices(len(edges), 2)
    coefficients = _solved(h[last] - h[first], g[last] - g[first])
    gains = np.einsum("pi,pi->p", coefficients, g[last] - g[first])
    return np.asarray(coefficients[int(np.argmax(gains))])


def _held(gain: Floats) -> NDArray[np.bool_]:
    """Windows (w,) in which a grip is worth its changes, from what it gains in each."""
    best = np.array([0.0, -_CHANGE])
    came_from = np.zeros((len(gain), 2), dtype=int)
    for k, value in enumerate(gain):
        changed = best[::-1] - _CHANGE
        came_from[k] = np.where(changed > best, [1, 0], [0, 1])
        best = np.maximum(best, changed) + np.array([0.0, value])
    state = int(np.argmax(best))
    held = np.zeros(len(gain), dtype=bool)
    for k in range(len(gain) - 1, -1, -1):
        held[k] = bool(state)
        state = int(came_from[k, state])
    return held


def _intervals(held: NDArray[np.bool_], start_s: Floats, window_s: float) -> list[Interval]:
    """On and off instants of runs of held windows; a run that reaches an end of the recording has no edge there."""
    padded = np.concatenate([[False], held, [False]]).astype(int)
    first, last = np.flatnonzero(np.diff(padded) == 1), np.flatnonzero(np.diff(padded) == -1)
    return [
        (
            0.0 if a == 0 else float(start_s[a]),
            _FOREVER if b == len(held) else float(start_s[b - 1] + window_s),
        )
        for a, b in zip(first, last, strict=True)
    ]


def hand_impedance(context: Context) -> list[Term]:
    """Grip inertia, damping and stiffness while the hand holds; in several recordings, in the first that shows one.

    A hand that never lets go is more inertia and friction, and a spring: laws of their own.
    """
    hessian, gradient = context.normal_of_forces(context.grip_forces())
    coefficients = _best_interval(hessian, gradient)
    held = np.zeros(len(hessian), dtype=bool)
    for _ in range(_TURNS):
        gain = 2.0 * gradient @ coefficients - np.einsum("wij,i,j->w", hessian, coefficients, coefficients)
        held = _held(gain)
        if not held.any() or held.all():
            break
        coefficients = _solved(hessian[held].sum(0)[None], gradient[held].sum(0)[None])[0]
    if not held.any():
        return []
    first = _term(context, coefficients, _grips(context, held))
    again, better = _by_prediction(context, first)
    if max(held.mean(), again.mean()) > _ALWAYS:
        return []
    return [first, *better]


def _grips(context: Context, held: NDArray[np.bool_]) -> tuple[tuple[Interval, ...], ...]:
    """Intervals of every recording from the windows (w,) in which the hand holds."""
    parts = np.split(held, np.cumsum([s.count for s in context.segments])[:-1])
    return tuple(
        tuple(_intervals(part, s.recording.time_s[s.windows.start], s.length * s.recording.period_s))
        for part, s in zip(parts, context.segments, strict=True)
    )


def _by_prediction(context: Context, first: Term) -> tuple[NDArray[np.bool_], list[Term]]:
    """Windows (w,) in which whole predictions are better with the grip, and it again, held there if that is elsewhere.

    A strong hand is beyond the linear response.
    """
    known = context.fit.solution
    present = known.hypothesis.held(known.u, len(known.hypothesis.terms))
    fitted = fit(context.segments, present.with_term(first), np.array(first.start), known.states, _LOOK).solution
    value = fitted.u
    everywhere = replace(first, grips=tuple(((0.0, _FOREVER),) for _ in context.segments))
    always, _ = fit_states(context.segments, present.with_term(everywhere), value, fitted.states)
    held = _held(known.loss - always.loss)
    grips = _grips(context, held) if held.any() else first.grips
    if grips == first.grips:
        return held, []
    found = first.parameters(value)
    coefficients = np.array([found["m_h"], found["b_h"], found["k_h"], found["k_h"] * found["rest"]])
    return held, [_term(context, coefficients, grips)]


def _term(context: Context, coefficients: Floats, grips: tuple[tuple[Interval, ...], ...]) -> Term:
    m, b, k, pull = (float(v) for v in coefficients)
    reach = max(context.span, context.resolution)
    limit_b, limit_k = 20.0 * context.force_scale / context.top_speed, 20.0 * context.force_scale / reach
    stiffness = float(np.clip(k, 1e-3 * context.force_scale / reach, 0.5 * limit_k))
    low, high = context.lowest - 0.5 * context.span, context.highest + 0.5 * context.span
    term = scalar_term(
        "hand_impedance",
        Scalar("m_h", float(np.clip(m, 0.0, 2.0 * context.inertia)), 0.0, 10.0 * context.inertia),
        Scalar("b_h", float(np.clip(b, 0.0, 0.5 * limit_b)), 0.0, limit_b),
        Scalar("k_h", stiffness, 0.0, limit_k),
        Scalar("rest", float(np.clip(pull / stiffness, low, high)), low, high),
        trials=float(_EDGES),
    )
    longest = max((g for of_one in grips for g in of_one), key=lambda grip: min(grip[1], context.duration) - grip[0])

    def parameters(u: Floats) -> Mapping[str, float]:
        return {**term.parameters(u), "on_s": longest[0], "off_s": longest[1]}

    def write(vector: Floats, u: Floats) -> None:
        term.write(vector, u)
        vector[word("hand_impedance.on_s")], vector[word("hand_impedance.off_s")] = longest

    return Term(
        "hand_impedance",
        term.coordinates,
        write,
        parameters,
        term.start,
        term.trials,
        grips=grips,
        form={
            "grips_s": [[list(grip) for grip in of_one] for of_one in grips],
            "on_s_standard_error": context.window_s / np.sqrt(3.0),
            "off_s_standard_error": context.window_s / np.sqrt(3.0),
        },
    )
