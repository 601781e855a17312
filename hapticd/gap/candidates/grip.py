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
from hapticd.plant.layout import word

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
_LIKELY = 4.0
"""Loss within which an edge is as likely as the best (95 %)."""
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
    gain = 2.0 * gradient @ coefficients - np.einsum("wij,i,j->w", hessian, coefficients, coefficients)
    first = _term(context, coefficients, held, gain)
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
    gain = known.loss - always.loss
    held = _held(gain)
    if not held.any():
        return held, []
    found = first.parameters(value)
    coefficients = np.array([found["m_h"], found["b_h"], found["k_h"], found["k_h"] * found["rest"]])
    return held, [_term(context, coefficients, held, gain)]


def _edge(gain: Floats, at: int) -> tuple[int, int]:
    """First and last window before which a hand may have taken hold (or let go), from what holding gains in each (w,).

    Args:
        gain: negative where nobody holds.
        at: the likeliest.
    """
    # The loss of an edge before window k is what is gained before it and lost after it.
    loss = np.concatenate([[0.0], np.cumsum(gain)])
    loss = np.abs(loss - loss[at])
    first = last = at
    while first > 0 and loss[first - 1] < _LIKELY:
        first -= 1
    while last < len(gain) and loss[last + 1] < _LIKELY:
        last += 1
    return first, last


def _longest(
    context: Context, grips: tuple[tuple[Interval, ...], ...], gain: Floats
) -> tuple[int, int, Floats, Floats]:
    """Which grip lasts longest (recording and number), and the middle and the standard error of its two edges [s]."""
    _, number, place = max(
        (min(off, context.duration) - on, number, place)
        for number, of_one in enumerate(grips)
        for place, (on, off) in enumerate(of_one)
    )
    segment = context.segments[number]
    start = segment.recording.time_s[segment.windows.start]
    own = np.split(gain, np.cumsum([s.count for s in context.segments])[:-1])[number]
    middle, error = np.array(grips[number][place]), np.full(2, context.window_s / np.sqrt(3.0))
    for edge, at_s in enumerate(grips[number][place]):
        if start[0] < at_s < start[-1]:
            first, last = _edge(own, int(np.argmin(np.abs(start - at_s))))
            low, high = start[first], start[min(last, len(start) - 1)]
            middle[edge] = 0.5 * (low + high)
            error[edge] += 0.5 * (high - low) / 1.96
    return number, place, middle, error


def _term(context: Context, coefficients: Floats, held: NDArray[np.bool_], gain: Floats) -> Term:
    """The effect with given coefficients, held in some windows (w,); `gain` (w,) is what holding gains in each."""
    grips = _grips(context, held)
    number, place, middle, error = _longest(context, grips, gain)
    longest = (float(middle[0]), float(middle[1]))
    of_one = (*grips[number][:place], longest, *grips[number][place + 1 :])
    grips = (*grips[:number], of_one, *grips[number + 1 :])
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
            "on_s_standard_error": float(error[0]),
            "off_s_standard_error": float(error[1]),
        },
    )
