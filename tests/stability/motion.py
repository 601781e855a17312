"""The loop of Fig. 2 one period at a time, straight from eq. 7–9: what the theory is checked against."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapticd.plant.exact import propagate
from hapticd.stability.damping import Damper
from hapticd.stability.numbers import Dimensionless
from hapticd.stability.storage import FloatArray, storage
from hapticd.stability.whole_loop import blank


@dataclass
class Motion:
    """A simulated run: states at the samples h and at h + τ_D, and the extremes met on the way."""

    numbers: Dimensionless
    at_rest: bool = False
    grew: bool = False
    samples: list[tuple[float, float]] = field(default_factory=list)
    switches: list[tuple[float, float]] = field(default_factory=list)
    top_speed: float = 0.0
    top_acceleration: float = 0.0

    def energy(self, at: str = "samples") -> NDArray[np.float64]:
        states = np.array(getattr(self, at))
        return storage(states[:, 0], states[:, 1], self.numbers.mu)


def simulate(numbers: Dimensionless, xi: float, xi_dot: float, periods: int, limit: float = 1e9) -> Motion:
    """Run until rest, growth past the limit, or the horizon; no force acts before the first command arrives."""
    mu, beta, sigma = numbers.mu, numbers.beta, numbers.sigma
    whole = math.floor(numbers.tau_d)
    fraction = numbers.tau_d - whole
    commands = [0.0] * (whole + 2)
    run = Motion(numbers, top_speed=abs(xi_dot))
    still = 0

    def advance(force: float, duration: float) -> None:
        nonlocal xi, xi_dot
        drag = force - beta * xi_dot
        run.top_acceleration = max(run.top_acceleration, (abs(drag) + sigma) / mu)
        xi, xi_dot = propagate(xi, xi_dot, duration, force, mu, beta, sigma)
        run.top_speed = max(run.top_speed, abs(xi_dot))

    for _ in range(periods):
        run.samples.append((xi, xi_dot))
        commands = [-math.floor(xi) - 0.5, *commands[:-1]]
        if fraction > 0.0:
            advance(commands[whole + 1], fraction)
        run.switches.append((xi, xi_dot))
        advance(commands[whole], 1.0 - fraction)
        if abs(xi) > limit:
            run.grew = True
            break
        held = xi_dot == 0.0 and all(abs(c) <= sigma for c in (*commands[: whole + 1], math.floor(xi) + 0.5))
        still = still + 1 if held else 0
        if still > whole + 2:
            run.at_rest = True
            break
    run.samples.append((xi, xi_dot))
    return run


def loop_record(numbers: Dimensionless, damper: Damper, xi: FloatArray, xi_dot: FloatArray) -> NDArray[Any]:
    """One loop with n starts; (n,) of `LOOP`."""
    loops = blank(np.broadcast(xi, xi_dot).size)
    for name in ("mu", "beta", "sigma", "tau_d", "kappa"):
        loops[name] = getattr(numbers, name)
    for name in ("beta_v", "periods", "keep"):
        loops[name] = getattr(damper, name)
    loops["xi"], loops["xi_dot"] = xi, xi_dot
    return loops
