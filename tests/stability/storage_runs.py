"""Exact runs of the whole loop that is in the theorems, and what S does in them.

Written apart from the product's loops: a quantiser with dither, half tick and side, a converter that rounds and saturates,
virtual damping with each velocity estimate, fractional delay, a hand's stiffness. Between two changes of force the motion is
the closed form of `hapticd.plant.spring`; S is looked at `_LOOKS` times in each piece.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numba import from_dtype, types
from numpy.typing import NDArray

from hapticd.jit import njit
from hapticd.plant.noise import next_uniform
from hapticd.plant.spring import propagate_with_stiffness

#: A loop and a start; forces in ticks, positions in ticks, times in periods.
CASE: Final = np.dtype(
    [
        ("mu", "f8"),
        ("beta", "f8"),
        ("sigma", "f8"),
        ("tau_d", "f8"),
        ("kappa", "f8"),
        ("bias", "f8"),  # ½, or 0 without the half tick
        ("side", "f8"),  # 0 both, ±1 one
        ("beta_v", "f8"),
        ("periods", "i8"),
        ("keep", "f8"),
        ("dither", "f8"),  # ± so many ticks
        ("counts", "i8"),  # in a tick
        ("step", "f8"),  # of the converter; 0: none
        ("limit", "f8"),  # of the force; 0: none
        ("xi", "f8"),
        ("xi_dot", "f8"),
        ("seed", "i8"),
    ],
    align=True,
)
_LOOKS: Final = 5
_MOST: Final = 64

#: S at the start, its largest value, its largest rise above the value at the last sample, top speed, speed at the end, and
#: the largest rise of the paper's H_T (35) from one sample to the next (of the spring of eq. 2 alone).
START, LARGEST, RISE, TOP_SPEED, LAST_SPEED, QUANTISED_RISE = range(6)


@njit(inline=True)
def _well(x: float, limit: float) -> float:
    """Potential of a spring of slope 1 that saturates."""
    a = abs(x)
    if limit > 0.0 and a > limit:
        return float(limit * (a - 0.5 * limit))
    return float(0.5 * a * a)


@njit(inline=True)
def _stored(case: Any, x: float, v: float) -> float:
    """S = ½μξ̇² + ½κξ² + the potential of the sampled spring's ideal."""
    place = x - (0.5 - case.bias)
    if place * case.side < 0.0:
        place = 0.0
    return float(0.5 * case.mu * v * v + 0.5 * case.kappa * x * x + _well(place, case.limit))


@njit(types.void(types.Array(from_dtype(CASE), 1, "C"), types.int64, types.Array(types.float64, 2, "C")))
def _run_all(cases: Any, horizon: int, out: Any) -> None:
    ring, seen = np.zeros(_MOST), np.zeros(_MOST)
    for k in range(len(cases)):
        case = cases[k]
        random = case.seed
        ring[:] = 0.0
        whole = math.floor(case.tau_d)
        fraction = case.tau_d - whole
        x, v, velocity = case.xi, case.xi_dot, 0.0
        first = _stored(case, x, v)
        largest, rise, top = first, 0.0, abs(v)
        before, quantised_rise = np.inf, 0.0
        for h in range(horizon):
            raw = math.floor(x * case.counts)
            plain = math.floor(raw / case.counts)
            read = plain
            if case.dither > 0.0:
                # as often at its ends as within: they are the worst
                random, value = next_uniform(random)
                value = min(1.0, max(-1.0, 2.0 * value))
                read = math.floor(raw / case.counts + case.dither * value)
            window = min(h, case.periods)
            if h > 0:
                difference = (plain - seen[(h - window) % _MOST]) / window
                velocity = case.keep * velocity + (1.0 - case.keep) * difference
            seen[h % _MOST] = plain
            force = -(read + case.bias) - case.beta_v * velocity
            if (case.side > 0.0 and (read < 0.0 or force > 0.0)) or (case.side < 0.0 and (read >= 0.0 or force < 0.0)):
                force = 0.0
            if case.limit > 0.0:
                force = min(case.limit, max(-case.limit, force))
            if case.step > 0.0:
                force = case.step * np.rint(force / case.step)
            ring[h % _MOST] = force
            at_sample = _stored(case, x, v)
            rho = x - math.floor(x)
            quantised = at_sample + 0.5 * (rho - rho * rho)
            quantised_rise = max(quantised_rise, quantised - before)
            before = quantised
            for part in range(2):
                span = fraction if part == 0 else 1.0 - fraction
                late = h - whole - 1 if part == 0 else h - whole
                held = ring[late % _MOST] if late >= 0 else 0.0
                for _ in range(_LOOKS):
                    if span > 0.0:
                        x, v = propagate_with_stiffness(
                            x, v, span / _LOOKS, held, case.mu, case.beta, case.sigma, case.kappa
                        )
                    now = _stored(case, x, v)
                    largest, top = max(largest, now), max(top, abs(v))
                    rise = max(rise, now - at_sample)
            if not abs(x) < 1e9:
                break
        out[k, START], out[k, LARGEST], out[k, RISE] = first, largest, rise
        out[k, TOP_SPEED], out[k, LAST_SPEED], out[k, QUANTISED_RISE] = top, abs(v), quantised_rise


def runs(cases: NDArray[Any], horizon: int = 400) -> NDArray[np.float64]:
    """Run cases for a number of periods; (n, 6), see START …."""
    out = np.zeros((cases.size, 6))
    _run_all(np.ascontiguousarray(cases), horizon, out)
    return out


def blank(count: int) -> NDArray[Any]:
    """Cases with the spring of eq. 2 and nothing else."""
    cases = np.zeros(count, CASE)
    cases["bias"], cases["periods"], cases["counts"], cases["mu"] = 0.5, 1, 1, 100.0
    cases["seed"] = np.arange(count)
    return cases
