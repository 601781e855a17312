"""Five machines, drawn by ranges: sizes, friction, controller, what they do, and how often they are looked at."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from benchmarks.gap.foreign import excite
from benchmarks.gap.foreign.simulate import Floats, Loop, Machine

Rng = np.random.Generator

FRICTIONS = ("straight", "degressive", "stribeck", "rising", "presliding")
"""Linear in speed; bends down; falls from rest; rises from rest; elastic before it slides. All slide on stiff bristles."""


class Drawn(NamedTuple):
    """A machine that is about to be played."""

    machine: Machine
    loop: Loop
    reference: Floats
    feed: Floats
    disturbance: Floats
    tick_s: float
    rate_hz: float
    """Of the record."""
    is_linear: bool
    is_force: bool
    """Whether the record has a force or torque in place of a current."""
    start: float = 0.0


class _Size(NamedTuple):
    coulomb: float
    speed: float
    travel: float
    ramp_s: float
    ratio: float
    """Of the torque that accelerates over that of friction."""
    resolution: float
    torque_constant: float

    @property
    def inertia(self) -> float:
        return self.ratio * self.coulomb * self.ramp_s / self.speed


def between(rng: Rng, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def rubbed(size: _Size, friction: str, rng: Rng) -> Machine:
    """A machine with a friction of `FRICTIONS`."""
    c, speed = size.coulomb, size.speed
    breakaway = size.resolution * between(rng, 0.02, 0.2)
    if friction == "presliding":
        breakaway = max(size.travel * between(rng, 1e-3, 8e-3), 4.0 * size.resolution)
    plain = {
        "inertia": size.inertia,
        "viscous": c / speed * between(rng, 0.3, 1.5),
        "coulomb": c,
        "torque_constant": size.torque_constant,
        "resolution": size.resolution,
        "breakaway": breakaway,
        "bristle_damping": 2.0 * rng.uniform(0.3, 1.0) * math.sqrt(c / breakaway * size.inertia),
    }
    if friction == "degressive":
        exponent, bend = rng.uniform(0.25, 0.6), speed * between(rng, 0.03, 0.2)
        share = (1.0 + speed / bend) ** (exponent - 1.0)
        return Machine(
            **plain | {"viscous": c / speed * between(rng, 0.7, 2.5) / share}, exponent=exponent, bend_speed=bend
        )
    if friction == "stribeck":
        return Machine(**plain, stribeck=rng.uniform(0.3, 1.0), stribeck_speed=speed * between(rng, 0.02, 0.15))
    if friction == "rising":
        return Machine(**plain, stribeck=-rng.uniform(0.3, 0.7), stribeck_speed=speed * between(rng, 0.02, 0.15))
    return Machine(**plain)


def _loop(machine: Machine, size: _Size, rate_hz: float, every: int, rng: Rng, integral: bool) -> Loop:
    bandwidth = 2.0 * math.pi * min(between(rng, 1.5, 8.0), rate_hz / 20.0)
    kp, kd = machine.inertia * bandwidth**2, 1.6 * machine.inertia * bandwidth
    stiff = max(1.0, 3.0 * size.coulomb / size.travel / kp)  # a loop that friction does not stop on its way
    ki = kp * bandwidth * 0.1 if integral else 0.0
    limit = 4.0 * size.coulomb * (1.5 + size.ratio)
    return Loop(kp * stiff, kd * math.sqrt(stiff), ki, 1.5 / rate_hz, limit, every, 0)


def _clock(rng: Rng, rates: tuple[float, ...], samples: float) -> tuple[float, int, Floats]:
    """Rate of the record, ticks of a controller's period, and the ticks."""
    rate = float(rng.choice(rates))
    every = max(2, math.ceil(400.0 / rate))
    duration = min(max(samples / rate, 8.0), 40.0)
    return rate, every, np.arange(round(duration * rate * every)) / (rate * every)


def _followed(
    size: _Size, machine: Machine, clock: tuple[float, int, Floats], reference: Floats, rng: Rng, **more: bool
) -> Drawn:
    rate, every, t = clock
    disturbance = excite.wander(t.size, t[1], size.coulomb * rng.choice([0.005, 0.02, 0.04]), rng)
    loop = _loop(machine, size, rate, every, rng, bool(rng.random() < 0.4))
    feed = np.zeros(t.size)
    if rng.random() < 0.5:  # most drives know their own inertia and friction, more or less
        rates = np.gradient(reference, t)
        feed = 0.8 * (machine.inertia * np.gradient(rates, t) + size.coulomb * np.tanh(20.0 * rates / size.speed))
        feed = np.clip(feed, -loop.limit, loop.limit)
    return Drawn(machine, loop, reference, feed, disturbance, t[1], rate, more["is_linear"], more["is_force"])


def robot_joint(friction: str, rng: Rng) -> Drawn:
    """A geared joint that follows a trajectory; torques at its output."""
    size = _Size(
        coulomb=between(rng, 0.8, 8.0), speed=between(rng, 0.6, 2.5), travel=rng.uniform(0.4, 1.5),
        ramp_s=rng.uniform(0.1, 0.3), ratio=between(rng, 0.5, 3.0),
        resolution=2 * math.pi / 2.0 ** int(rng.integers(16, 20)), torque_constant=between(rng, 2.0, 15.0),
    )  # fmt: skip
    machine = rubbed(size, friction, rng)
    if rng.random() < 0.4:
        machine = machine._replace(gravity=size.coulomb * between(rng, 0.3, 2.0), hangs_at=rng.uniform(-1.0, 1.0))
    clock = _clock(rng, (40.0, 100.0, 100.0, 125.0, 200.0, 500.0), 4000)
    shape = rng.choice([excite.sines, excite.moves, excite.sweep])
    return _followed(
        size, machine, clock, shape(clock[2], size.travel, size.speed, rng), rng,
        is_linear=False, is_force=bool(rng.random() < 0.5),
    )  # fmt: skip


def position_axis(friction: str, rng: Rng) -> Drawn:
    """A linear axis under a position loop, as EMPS."""
    size = _Size(
        coulomb=between(rng, 5.0, 60.0), speed=between(rng, 0.08, 0.5), travel=rng.uniform(0.08, 0.3),
        ramp_s=rng.uniform(0.08, 0.2), ratio=between(rng, 0.8, 5.0), resolution=float(rng.choice([1e-7, 1e-6, 5e-6])),
        torque_constant=between(rng, 10.0, 80.0),
    )  # fmt: skip
    machine = rubbed(size, friction, rng)
    if rng.random() < 0.3:
        machine = machine._replace(bias=size.coulomb * rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.3))
    if rng.random() < 0.3:
        machine = machine._replace(asymmetry=rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.3))
    clock = _clock(rng, (100.0, 250.0, 500.0, 997.0, 1000.0, 2000.0), 8000)
    shape = rng.choice([excite.sines, excite.moves, excite.moves, excite.sweep])
    return _followed(
        size, machine, clock, shape(clock[2], size.travel, size.speed, rng), rng, is_linear=True, is_force=True
    )


def pendulum(friction: str, rng: Rng) -> Drawn:
    """An arm on a motor of little gearing, swung by torques and held back by a weak loop."""
    weight, length = between(rng, 0.6, 5.0), rng.uniform(0.25, 0.6)
    c, speed = weight * between(rng, 0.03, 0.2), rng.uniform(2.0, 6.0)
    size = _Size(
        coulomb=c, speed=speed, travel=rng.uniform(0.8, 2.5), ramp_s=0.2,
        ratio=weight * length / 9.81 * rng.uniform(1.0, 1.3) * speed / (0.2 * c),
        resolution=2 * math.pi / float(rng.choice([4096, 8192, 16384, 65536])), torque_constant=between(rng, 0.1, 1.0),
    )  # fmt: skip
    machine = rubbed(size, friction, rng)._replace(gravity=weight, hangs_at=rng.choice([0.0, rng.uniform(-0.3, 0.3)]))
    rate, every, t = clock = _clock(rng, (40.0, 100.0, 200.0, 200.0, 500.0), 5000)
    if rng.random() < 0.4:
        reference = excite.sines(t, size.travel, speed, rng)
        return _followed(size, machine, clock, reference, rng, is_linear=False, is_force=bool(rng.random() < 0.7))
    drive = excite.smooth_noise(t, rng.uniform(0.6, 2.0), rng) * weight * rng.uniform(0.3, 0.7)
    held = np.repeat(drive[::every], every)[: t.size]
    held_back = rng.uniform(0.4, 1.0) * math.sqrt(machine.inertia * weight)
    loop = Loop(0.3 * weight, held_back, 0.0, 1.5 / rate, 3.0 * weight, every, 0)
    disturbance = excite.wander(t.size, t[1], c * rng.choice([0.01, 0.04, 0.1]), rng)
    return Drawn(
        machine,
        loop,
        np.zeros(t.size),
        held,
        disturbance,
        t[1],
        rate,
        False,
        bool(rng.random() < 0.7),
        machine.hangs_at,
    )


def cogging_motor(friction: str, rng: Rng) -> Drawn:
    """A direct-drive motor under a speed or position loop, with cogging."""
    speed = between(rng, 3.0, 30.0)
    size = _Size(
        coulomb=between(rng, 3e-3, 3e-2), speed=speed, travel=rng.uniform(2.0, 12.0), ramp_s=rng.uniform(0.05, 0.15),
        ratio=between(rng, 0.4, 3.0), resolution=2 * math.pi / float(rng.choice([4096, 8192, 16384, 65536])),
        torque_constant=between(rng, 0.02, 0.3),
    )  # fmt: skip
    poles = int(rng.choice([7, 11, 12, 14]))
    orders = sorted({float(poles), float(poles * rng.choice([2, 3, 6])), float(rng.choice([1, 2, poles + 1]))})
    machine = rubbed(size, friction, rng)._replace(
        orders=tuple(orders),
        amplitudes=tuple(size.coulomb * between(rng, 0.1, 0.7) for _ in orders),
        phases=tuple(rng.uniform(0.0, 6.28) for _ in orders),
    )
    clock = _clock(rng, (200.0, 440.0, 500.0, 1000.0, 2000.0), 8000)
    shape = rng.choice([excite.levels, excite.levels, excite.sines])
    return _followed(
        size, machine, clock, shape(clock[2], size.travel, speed, rng), rng, is_linear=False, is_force=False
    )


def slow_drive(friction: str, rng: Rng) -> Drawn:
    """A direct drive moved by slow triangles of current, or of position, with rests of seconds and creep before it goes."""
    speed = between(rng, 15.0, 80.0)
    size = _Size(
        coulomb=between(rng, 8e-3, 4e-2), speed=speed, travel=10.0, ramp_s=rng.uniform(0.3, 0.8),
        ratio=between(rng, 0.15, 0.8), resolution=2 * math.pi / float(rng.choice([8192, 16384, 65536])),
        torque_constant=between(rng, 0.03, 0.2),
    )  # fmt: skip
    machine = rubbed(size, "rising", rng)._replace(stribeck_speed=between(rng, 0.1, 0.8))
    if friction == "presliding":
        breakaway = between(rng, 2e-3, 1e-2)
        machine = machine._replace(
            breakaway=breakaway, bristle_damping=0.6 * math.sqrt(size.coulomb / breakaway * size.inertia)
        )
    rate, every, t = clock = _clock(rng, (500.0, 1000.0, 1000.0), 14_000)
    if rng.random() < 0.3:
        peak = rng.uniform(0.4, 1.0) * speed
        reference = excite.triangle(t, peak * 0.5, rng)
        return _followed(size, machine, clock, reference, rng, is_linear=False, is_force=False)
    peak = size.coulomb * rng.uniform(1.6, 2.6)
    held = np.repeat(excite.triangle(t, peak, rng)[::every], every)[: t.size]
    loop = Loop(0.0, 0.0, 0.0, 0.0, 2.0 * peak, every, 0)
    disturbance = excite.wander(t.size, t[1], size.coulomb * rng.choice([0.005, 0.02, 0.05]), rng)
    return Drawn(machine, loop, np.zeros(t.size), held, disturbance, t[1], rate, False, False)


MACHINES: dict[str, Callable[[str, Rng], Drawn]] = {
    "robot_joint": robot_joint,
    "position_axis": position_axis,
    "pendulum": pendulum,
    "cogging_motor": cogging_motor,
    "slow_drive": slow_drive,
}
