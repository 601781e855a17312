"""Devices with effects solved independently: scipy's solve_ivp over plain Python laws, stops located as events."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hapticd.config import load_config
from hapticd.plant.electrical import electrical
from hapticd.plant.layout import SIZE, STATE, device_vector, index_of, initial_state
from hapticd.plant.numeric import simulate_windows_serial
from hapticd.plant.resolution import substeps_for

J, B, C, KT = 6.28e-6, 9.0e-6, 2.0e-3, 0.0292
PERIOD = 1e-3

Floats = NDArray[np.float64]


def vector(**changes: float | Sequence[float]) -> Floats:
    """The RE35 with an ideal amplifier; changes are words, dotted with ``__``."""
    p = device_vector(load_config(None))
    p[index_of("delay_s")] = 0.0
    for name, value in changes.items():
        first = index_of(name.replace("__", "."))
        values = np.atleast_1d(np.asarray(value, dtype=float))
        p[first : first + len(values)] = values
    assert p.shape == (SIZE,)
    return p


def times(ticks: int, period: float = PERIOD) -> Floats:
    return np.arange(ticks + 1) * period


def motor_current(
    p: Floats, currents: Floats, substeps: int, lost: Sequence[int] = (), period: float = PERIOD
) -> Floats:
    """`electrical` over a record of equal ticks."""
    mask = np.zeros(len(currents), np.uint8)
    mask[list(lost)] = 1
    out = np.empty((len(currents), substeps))
    electrical(p, times(len(currents) - 1, period), currents, mask, substeps, out)
    return out


def simulated(
    p: Floats,
    currents: Floats,
    state: Floats | None = None,
    substeps: int | None = None,
    period: float = PERIOD,
) -> tuple[Floats, Floats]:
    """Positions after every tick under one current a tick, and the last state."""
    count = len(currents)
    substeps = substeps or substeps_for(p, period)
    start = initial_state() if state is None else state
    drive = motor_current(p, np.append(currents, currents[-1]), substeps, period=period)
    positions, end = np.empty((1, count)), np.empty((1, STATE))
    simulate_windows_serial(
        p, times(count, period), drive, np.zeros(1, np.int64), count, start[None].copy(), positions, end
    )
    return positions[0], end[0]


def excitation(ticks: int, seed: int = 0) -> Floats:
    """Currents with reversals, stops and steps: slow and fast sines, and a new offset every 20 ticks."""
    random = np.random.default_rng(seed)
    t = np.arange(ticks) * PERIOD
    steps = np.repeat(random.uniform(-0.15, 0.15, -(-ticks // 20)), 20)[:ticks]
    return 0.1 * np.sin(2 * np.pi * 11 * t) + 0.08 * np.sin(2 * np.pi * 67 * t + 1.0) + steps


@dataclass
class Laws:
    """One mass with friction: torques of position, friction level, and viscous torque, in plain Python."""

    field: Callable[[float, float, float], float] = lambda x, current, t: 0.0
    level: Callable[[float, float, float], float] = lambda speed, current, t: C
    drag: Callable[[float, float], float] = lambda v, t: B * v
    inertia: Callable[[float], float] = lambda t: J
    breaks: tuple[float, ...] = ()

    def run(self, currents: Floats, x: float = 0.0, v: float = 0.0, rtol: float = 1e-10) -> Floats:
        positions = np.empty(len(currents))
        for k, current in enumerate(currents):
            edges = [k * PERIOD, *(b for b in self.breaks if k * PERIOD < b < (k + 1) * PERIOD), (k + 1) * PERIOD]
            for begin, end in pairwise(edges):
                x, v = self._constant(x, v, float(current), begin, end, rtol)
            positions[k] = x
        return positions

    def _constant(self, x: float, v: float, current: float, t: float, end: float, rtol: float) -> tuple[float, float]:
        def at_rest(t: float, y: Floats) -> float:
            return float(y[1])

        at_rest.terminal = True  # type: ignore[attr-defined]
        middle = 0.5 * (t + end)
        while end - t > 1e-13:
            pull = KT * current + self.field(x, current, middle)
            if v == 0.0 and abs(pull) <= self.level(0.0, current, middle):
                break
            sign = math.copysign(1.0, v if v != 0.0 else pull)
            at_rest.direction = -sign  # type: ignore[attr-defined]

            def motion(t: float, y: Floats, sign: float = sign) -> tuple[float, float]:
                force = KT * current + self.field(y[0], current, middle)
                force -= sign * self.level(abs(y[1]), current, t) + self.drag(y[1], middle)
                return y[1], force / self.inertia(middle)

            solved = solve_ivp(
                motion, (t, end), (x, v), method="DOP853", rtol=rtol, atol=1e-12, max_step=PERIOD / 2, events=at_rest
            )
            x, v, t = float(solved.y[0, -1]), float(solved.y[1, -1]), float(solved.t[-1])
            if solved.status == 1:
                v = 0.0
        return x, v


def stiff(
    motion: Callable[[float, Floats, float], Any], currents: Floats, y: Sequence[float], rtol: float = 1e-9
) -> Floats:
    """Positions (first component) of a smooth or regularised system under one current a tick, by LSODA."""
    state = np.array(y, dtype=float)
    positions = np.empty(len(currents))
    for k, current in enumerate(currents):
        solved = solve_ivp(
            lambda t, y, current=float(current): motion(t, y, current),
            (k * PERIOD, (k + 1) * PERIOD),
            state,
            method="LSODA",
            rtol=rtol,
            atol=1e-13,
            max_step=PERIOD / 4,
        )
        state = solved.y[:, -1]
        positions[k] = state[0]
    return positions


def apart(got: Floats, expected: Floats) -> float:
    """Largest distance of two trajectories relative to the way that the expected one covers."""
    return float(np.abs(got - expected).max() / np.ptp(expected))
