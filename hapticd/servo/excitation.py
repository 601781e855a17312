"""Excitations for identification: the signals of ``hapticd excite``.

An excitation is a table with one column per tick and two rows: additional current (A) and displacement of the spring's
origin (raw counts). The spring stays on, so the shaft is always held; every safety trip stays active. A shape beyond the
limits is refused before any motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy  # loads scipy.signal at its first use, which takes half a second

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from hapticd.config import Config


_SAMPLES_PER_PERIOD = 4.0
"""Smallest number with which a sine held from tick to tick is still a sine."""


class ExcitationError(ValueError):
    """An excitation cannot be run: unknown name, or beyond a limit (the message has value, limit and unit)."""


@dataclass(frozen=True)
class Plan:
    """Parameters of a shape; each shape uses some of them."""

    amplitude: float
    """Peak: A for current shapes, rad or m for shapes that move the origin."""
    duration_s: float
    low_hz: float = 0.5
    high_hz: float = 40.0
    seed: int = 1


@dataclass(frozen=True)
class Shape:
    """One entry of ``hapticd excite --list``."""

    name: str
    summary: str
    moves_origin: bool
    duration_s: float
    build: Callable[[Plan, NDArray[np.float64]], NDArray[np.float64]]
    effort: float = 4.0
    """Default amplitude of a current shape, in multiples of the break-away current."""
    sweeps_frequency: bool = False
    """Whether it uses ``low_hz`` and ``high_hz`` of its plan."""


def _ramps(plan: Plan, t: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(plan.amplitude * scipy.signal.sawtooth(2 * np.pi * 2 * t / plan.duration_s + np.pi / 2, 0.5))


def _sweeps(plan: Plan, t: NDArray[np.float64]) -> NDArray[np.float64]:
    # Five speeds, each in both directions and on both sides; the slower ones take more of the time.
    cycles = np.array([1, 2, 3, 5, 8])
    share = np.full(len(cycles), plan.duration_s / len(cycles))
    starts = np.concatenate([[0.0], np.cumsum(share)])
    part = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(cycles) - 1)
    phase = (t - starts[part]) / share[part] * cycles[part]
    return np.asarray(plan.amplitude * scipy.signal.sawtooth(2 * np.pi * phase + np.pi / 2, 0.5))


def _chirp(plan: Plan, t: NDArray[np.float64]) -> NDArray[np.float64]:
    wave = scipy.signal.chirp(t, plan.low_hz, plan.duration_s, plan.high_hz, method="logarithmic", phi=-90)
    return np.asarray(plan.amplitude * wave)


def _steps(plan: Plan, t: NDArray[np.float64]) -> NDArray[np.float64]:
    random = np.random.default_rng(plan.seed)
    count = max(4, int(plan.duration_s / 0.25) // 2 * 2)
    half = random.uniform(0.25, 1.0, count // 2)
    levels = np.empty(count)
    levels[0::2], levels[1::2] = half, -half  # symmetric
    index = np.minimum((t / plan.duration_s * count).astype(int), count - 1)
    return np.asarray(plan.amplitude * levels[index])


def _release(plan: Plan, t: NDArray[np.float64]) -> NDArray[np.float64]:
    pattern = np.array([0.0, 1.0, 0.0, -1.0, 0.0, 0.5, 0.0, -0.5])
    index = np.minimum((t / plan.duration_s * len(pattern)).astype(int), len(pattern) - 1)
    return np.asarray(plan.amplitude * pattern[index])


SHAPES: dict[str, Shape] = {
    shape.name: shape
    for shape in (
        Shape("ramp", "slow triangular current ramps to both sides: breakaway and presliding", False, 20.0, _ramps),
        Shape(
            "sweep",
            "the spring's origin moves forth and back at five constant speeds: friction curve",
            True,
            20.0,
            _sweeps,
        ),
        Shape("chirp", "current sine of rising frequency: inertia, delay, resonances", False, 20.0, _chirp, 2.0, True),
        Shape("steps", "current steps of many heights to both sides: inertia, lag, saturation", False, 20.0, _steps),
        Shape(
            "release",
            "the origin jumps to both sides and back: free decay of the rendered spring",
            True,
            16.0,
            _release,
        ),
    )
}


def default_plan(config: Config, shape: Shape) -> Plan:
    """A plan within the config's limits that moves the shaft of its plant model."""
    breakaway = config.plant.coulomb / config.amplifier.torque_constant
    if shape.moves_origin:
        stuck = config.plant.coulomb / config.spring.stiffness if config.spring.stiffness else 0.0
        amplitude = max(5.0 * stuck, 400.0 * config.raw_resolution, 8.0 * config.resolution)
        if config.safety.max_excursion:
            amplitude = min(amplitude, 0.4 * config.safety.max_excursion)
    else:
        amplitude = max(shape.effort * breakaway, 0.05)
        if config.amplifier.continuous_current:
            amplitude = min(amplitude, 0.8 * config.amplifier.continuous_current)
    high = min(40.0, config.servo.rate_hz / 10.0)
    return Plan(amplitude, shape.duration_s, min(0.5, high / 4), high)


ALL = "all"


def build(
    config: Config,
    name: str,
    *,
    amplitude: float | None = None,
    duration_s: float | None = None,
    low_hz: float | None = None,
    high_hz: float | None = None,
    seed: int = 1,
) -> NDArray[np.float64]:
    """The table of one shape, or of ``all`` one after the other (each with its default plan).

    Args:
        config: for rate, limits and defaults.
        name: a key of `SHAPES`, or ``all``.
        amplitude: peak; A, or rad or m for shapes that move the origin.
        duration_s: duration in s.
        low_hz: first frequency of a chirp, Hz. high_hz: last frequency, Hz.
        seed: of the random heights of ``steps``.

    Returns:
        Shape (2, ticks): additional current in A, displacement of the origin in raw counts.

    Raises:
        ExcitationError: unknown name, or the plan is beyond a limit of the config.
    """
    given = {"amplitude": amplitude, "duration_s": duration_s, "low_hz": low_hz, "high_hz": high_hz}
    chosen = {key: value for key, value in given.items() if value is not None}
    if name == ALL:
        if chosen:
            raise ExcitationError(f"all: takes no {next(iter(chosen))}; give one excitation to set it")
        pause = np.zeros((2, round(0.5 * config.servo.rate_hz)))
        parts = [part for shape in SHAPES for part in (build(config, shape, seed=seed), pause)]
        return np.concatenate(parts, axis=1)
    if name not in SHAPES:
        raise ExcitationError(f"excitation {name!r} is unknown (known: {', '.join([*SHAPES, ALL])})")
    shape = SHAPES[name]
    if not shape.sweeps_frequency and (wrong := {"low_hz", "high_hz"} & chosen.keys()):
        raise ExcitationError(f"{name}: takes no {min(wrong)}; it has no frequency range")
    plan = replace(default_plan(config, shape), **chosen, seed=seed)
    _check(config, shape, plan)
    if shape.sweeps_frequency:
        _check_frequencies(config, shape, plan)
    ticks = round(plan.duration_s * config.servo.rate_hz)
    wave = shape.build(plan, np.arange(ticks) / config.servo.rate_hz)
    table = np.zeros((2, ticks))
    if shape.moves_origin:
        table[1] = np.rint(wave / config.raw_resolution)
        if name == "sweep":
            _check_speed(config, table[1])
    else:
        table[0] = wave
    return table


def _check(config: Config, shape: Shape, plan: Plan) -> None:
    unit = ("m" if config.is_linear else "rad") if shape.moves_origin else "A"
    if not np.isfinite(plan.amplitude) or plan.amplitude <= 0.0:
        raise ExcitationError(f"{shape.name}: amplitude = {plan.amplitude:g}: must be above 0 {unit}")
    if not 0.5 <= plan.duration_s <= 600.0:
        raise ExcitationError(f"{shape.name}: duration = {plan.duration_s:g}: must be between 0.5 and 600 s")
    if shape.moves_origin:
        limit, key = config.safety.max_excursion, "half of safety.max_excursion"
        limit = limit / 2 if limit else None
    else:
        limit, key = config.amplifier.continuous_current, "amplifier.continuous_current"
    if limit and plan.amplitude > limit:
        raise ExcitationError(f"{shape.name}: amplitude = {plan.amplitude:g}: must be at most {limit:g} {unit} ({key})")


def _check_frequencies(config: Config, shape: Shape, plan: Plan) -> None:
    if not 0.0 < plan.low_hz < plan.high_hz:
        raise ExcitationError(
            f"{shape.name}: low_hz = {plan.low_hz:g}: must be above 0 Hz and below high_hz = {plan.high_hz:g} Hz"
        )
    highest = config.servo.rate_hz / _SAMPLES_PER_PERIOD
    if plan.high_hz > highest:
        raise ExcitationError(
            f"{shape.name}: high_hz = {plan.high_hz:g}: must be at most {highest:g} Hz "
            f"({_SAMPLES_PER_PERIOD:g} samples per period at servo.rate_hz)"
        )


def _check_speed(config: Config, origin: NDArray[np.float64]) -> None:
    speed = float(np.abs(np.diff(origin)).max(initial=0.0)) * config.raw_resolution * config.servo.rate_hz
    limit = config.safety.max_velocity
    if limit and speed > limit / 2:
        unit = "m/s" if config.is_linear else "rad/s"
        raise ExcitationError(
            f"sweep: the origin would move at {speed:.4g} {unit}: must be at most {limit / 2:g} {unit} "
            "(half of safety.max_velocity); make the amplitude smaller or the duration longer"
        )
