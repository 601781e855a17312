"""The equations of motion solved independently: at 60 digits with mpmath, and by scipy's solve_ivp with events."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import mpmath as mp
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

State = tuple[float, float]


def device_config(**changes: Any) -> SimpleNamespace:
    """What `init_plant` reads of a config, for the RE35 with an ideal amplifier; changes are dotted with ``__``."""
    config = SimpleNamespace(
        plant=SimpleNamespace(inertia=6.28e-6, viscous=9.0e-6, coulomb=2.0e-3, effects=()),
        hand=SimpleNamespace(inertia=0.0, damping=0.0, stiffness=0.0),
        amplifier=SimpleNamespace(torque_constant=0.0292, delay=0.0, dac_bits=0, dac_full_scale=6.0, peak_current=None),
        encoder=SimpleNamespace(invert=False),
        raw_resolution=2.0 * math.pi / 8192,
        origin_counts=0,
    )
    for name, value in changes.items():
        section, _, key = name.rpartition("__")
        setattr(getattr(config, section) if section else config, key, value)
    return config


def exact_reference(
    x: float, v: float, dt: float, force: float, inertia: float, viscous: float, coulomb: float, stiffness: float = 0.0
) -> tuple[Any, Any]:
    """Position and velocity after `dt` as mpmath numbers, from the textbook solution: roots, hyperbolic functions."""
    with mp.workdps(60):
        state = mp.mpf(x), mp.mpf(v)
        left = mp.mpf(dt)
        while True:
            pull = force - mp.mpf(stiffness) * state[0]
            if state[1] == 0 and abs(pull) <= coulomb:
                return state
            sign = mp.sign(state[1]) if state[1] != 0 else mp.sign(pull)
            net = force - sign * mp.mpf(coulomb)
            flow = _damped(inertia, viscous, net) if stiffness == 0 else _sprung(inertia, viscous, net, stiffness)
            stop = _stop_time(*state, sign, net, inertia, viscous, stiffness)
            if not stop < left:
                return flow(*state, left)
            state = flow(*state, stop)[0], mp.mpf(0)
            left -= stop


def _damped(inertia: float, viscous: float, net: Any) -> Callable[[Any, Any, Any], tuple[Any, Any]]:
    def flow(x: Any, v: Any, t: Any) -> tuple[Any, Any]:
        if viscous == 0:
            return x + v * t + net / inertia * t**2 / 2, v + net / inertia * t
        rate, final = mp.mpf(viscous) / inertia, net / viscous
        return x + final * t - (v - final) * mp.expm1(-rate * t) / rate, final + (v - final) * mp.exp(-rate * t)

    return flow


def _sprung(inertia: float, viscous: float, net: Any, stiffness: float) -> Callable[[Any, Any, Any], tuple[Any, Any]]:
    alpha, omega2 = mp.mpf(viscous) / (2 * mp.mpf(inertia)), mp.mpf(stiffness) / inertia
    kappa = mp.sqrt(mp.mpc(alpha**2 - omega2))
    centre = net / stiffness

    def flow(x: Any, v: Any, t: Any) -> tuple[Any, Any]:
        decay = mp.exp(-alpha * t)
        s = mp.re(decay * mp.sinh(kappa * t) / kappa) if kappa != 0 else decay * t
        c = mp.re(decay * mp.cosh(kappa * t))
        y = x - centre
        return centre + y * (c + alpha * s) + v * s, v * (c - alpha * s) - omega2 * y * s

    return flow


def _stop_time(x: Any, v: Any, sign: Any, net: Any, inertia: float, viscous: float, stiffness: float) -> Any:
    speed, a = abs(v), sign * (net - stiffness * x) / inertia
    alpha, omega2 = mp.mpf(viscous) / (2 * mp.mpf(inertia)), mp.mpf(stiffness) / inertia
    kappa2 = alpha**2 - omega2
    if kappa2 < 0:
        omega = mp.sqrt(-kappa2)
        return mp.atan2(speed * omega, alpha * speed - a) / omega
    kappa = mp.sqrt(kappa2)
    braking = (alpha - kappa) * speed - a
    if speed == 0 or braking <= 0:
        return mp.inf
    return speed / braking if kappa == 0 else mp.log1p(2 * kappa * speed / braking) / (2 * kappa)


def integrate(
    x: float,
    v: float,
    dt: float,
    force: float,
    inertia: float,
    viscous: float,
    coulomb: float,
    stiffness: float = 0.0,
    rtol: float = 1e-11,
) -> State:
    """The same by numerical integration, a phase of one direction at a time, stops located as events."""

    def at_rest(t: float, y: NDArray[np.float64]) -> float:
        return float(y[1])

    at_rest.terminal = True  # type: ignore[attr-defined]
    left = dt
    while left > 0.0:
        pull = force - stiffness * x
        if v == 0.0 and abs(pull) <= coulomb:
            break
        sign = math.copysign(1.0, v if v != 0.0 else pull)
        at_rest.direction = -sign  # type: ignore[attr-defined]

        def motion(t: float, y: NDArray[np.float64], sign: float = sign) -> tuple[float, float]:
            return y[1], (force - sign * coulomb - viscous * y[1] - stiffness * y[0]) / inertia

        result = solve_ivp(
            motion, (0.0, left), (x, v), method="DOP853", rtol=rtol, atol=1e-13, max_step=left / 4, events=at_rest
        )
        x, v = float(result.y[0, -1]), float(result.y[1, -1])
        if result.status != 1:
            break
        left -= float(result.t[-1])
        v = 0.0
    return x, v


def relative_error(got: State, expected: tuple[Any, Any], x: float, v: float, dt: float) -> float:
    """Largest error of both states relative to max(|x|, |v|·dt), the result's own size included when it starts at rest."""
    length = max(abs(x), abs(v) * dt, abs(float(expected[0] - x)))
    speed = max(abs(v), abs(float(expected[1])))
    position_error = abs(float(got[0] - expected[0]))
    velocity_error = abs(float(got[1] - expected[1]))
    return max(position_error / length if position_error else 0.0, velocity_error / speed if velocity_error else 0.0)
