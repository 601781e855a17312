"""One recording of a device with hidden effects, and what a perfect observer of it would see."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap import devices, physics, session
from benchmarks.gap.devices import Model
from benchmarks.gap.disturbance import Coloured, disturbed
from benchmarks.gap.hidden import Effect, hide, loss_probability
from benchmarks.gap.physics import LOAD_OMEGA, LOAD_THETA, OMEGA, STATE_WORDS, THETA, Device, Loop
from benchmarks.gap.session import Session

STEP_S = 5e-6
"""Longest integration step."""
WINDOW_S = 0.05
"""Length of the windows over which the effect of a hidden effect is judged."""
NOISE_COUNTS = 0.1
"""Standard deviation of the measured position before it is floored."""
_GENTLER = ((1.0, 1.0), (1.0, 0.7), (2.0, 0.7), (2.0, 0.5), (4.0, 0.5), (8.0, 0.35))
"""Softness of the spring and scale of the amplitudes, in the order in which a lab would try them."""


class UnstableError(Exception):
    """The device with these effects passes a safety limit even in the gentlest session."""


class Lab(NamedTuple):
    """A device, and how it is excited."""

    nominal: Model
    top_speed: float
    """Above this the excitation is made smaller, rad/s or m/s."""
    play: Callable[[Model, float, np.random.Generator, float, float], Session] = session.draw
    """A session for a nominal model, of a duration, with a softness of the spring and a scale of the amplitudes."""


def lab_of(device: str) -> Lab:
    """One of `devices.MODELS` and the usual session.

    Raises:
        KeyError: no device has this name.
    """
    return Lab(devices.model(device), devices.LAB_SPEED[device])


class Recording(NamedTuple):
    """Columns of a recording (shape (n,) each) and the truth behind them."""

    time_s: NDArray[np.float64]
    lateness_s: NDArray[np.float64]
    counts: NDArray[np.int64]
    current_command: NDArray[np.float64]
    origin_counts: NDArray[np.float64]
    states: NDArray[np.float64]
    """Shape (n, STATE_WORDS): the true states at the ticks."""
    device: Device
    nominal: Model
    stiffness: float
    """Of the virtual spring that held the device."""


def generate(
    effects: Sequence[Effect],
    seed: int,
    duration_s: float = 20.0,
    device: str | Lab = "re35",
    *,
    coloured: Coloured | None = None,
    step_s: float = STEP_S,
    noise_counts: float = NOISE_COUNTS,
) -> Recording:
    """Simulate an identification session of a device with hidden effects.

    Where the device becomes too fast or goes too far, the session is repeated more gently, as a lab would.

    Args:
        effects: ``{"name": slug, **parameters}`` each; see `hidden.LAWS`.
        seed: of the session, the noise, the lateness and the losses; the same numbers give the same recording.
        duration_s: length.
        device: one of `devices.MODELS`, or another with its excitation.
        coloured: a torque on the shaft that is no effect.
        step_s: longest integration step.
        noise_counts: standard deviation of the encoder's noise, in counts.

    Raises:
        UnstableError: no session is gentle enough.
    """
    lab = lab_of(device) if isinstance(device, str) else device
    nominal = lab.nominal
    true = hide(devices.base_device(nominal), effects)
    true = disturbed(true, coloured, nominal["plant"]["coulomb"], duration_s + 1.0, seed)
    for softness, scale in _GENTLER:
        rng = np.random.default_rng([seed, 0x6A9])
        drawn = lab.play(nominal, duration_s, rng, softness, scale)
        n = drawn.times.size
        noise = rng.normal(0.0, 1.0, n) * noise_counts * true.resolution
        lost = rng.random(n) < loss_probability(effects)
        start = np.zeros(STATE_WORDS)
        start[THETA] = start[LOAD_THETA] = rng.uniform(0.0, 1.0) * true.resolution
        counts, commanded, _, states, done = physics.run(
            true,
            _loop(lab, drawn.stiffness),
            drawn.times,
            drawn.extra,
            drawn.origin,
            lost,
            noise,
            start,
            step_s,
        )
        if done == n:
            return Recording(
                drawn.times, drawn.lateness, counts, commanded, drawn.origin, states, true, nominal, drawn.stiffness
            )
    name = device if isinstance(device, str) else "a device of its own"
    raise UnstableError(f"{name} with {[effect['name'] for effect in effects]}, seed {seed}")


def _loop(lab: Lab, stiffness: float) -> Loop:
    nominal = lab.nominal
    amplifier, safety = nominal["amplifier"], nominal["safety"]
    return Loop(
        stiffness=stiffness,
        torque_constant=amplifier["torque_constant"],
        decimation=nominal["encoder"].get("decimation", 1),
        dac_step=devices.dac_step(nominal),
        peak_current=amplifier["peak_current"] or math.inf,
        max_omega=lab.top_speed,
        max_theta=safety["max_excursion"],
    )


def visibility(
    recording: Recording,
    effects: Sequence[Effect] | None = None,
    step_s: float = 2.0 * STEP_S,
    *,
    knows_coloured: bool = True,
) -> float:
    """How far a model is off over windows of `WINDOW_S`, as a perfect observer sees it.

    The model is started at the true state of each window and driven by the recorded commands; of the difference of the
    shown positions, what an initial position and velocity can explain is taken away. The RMS of the rest, in units of
    the standard deviation of a count, δ/√12: a perfect observer's gap is √(1 + v²).

    Args:
        recording: what happened.
        effects: what the model knows of; None for the nominal model.
        step_s: longest integration step.
        knows_coloured: whether the observer also knows the coloured torque, so that only effects count.
    """
    known = hide(devices.base_device(recording.nominal), effects or [])
    if knows_coloured:
        known = known._replace(coloured=recording.device.coloured, coloured_step_s=recording.device.coloured_step_s)
    n = recording.time_s.size
    length = round(WINDOW_S * recording.nominal["servo"]["rate_hz"]) + 1
    first = np.arange(0, n - length, length - 1)
    starts = np.ascontiguousarray(recording.states[first])
    starts[:, LOAD_THETA], starts[:, LOAD_OMEGA] = starts[:, THETA], starts[:, OMEGA]
    modelled = physics.replay(known, recording.time_s, recording.current_command, starts, first, length, step_s)
    true = np.array([physics.measured(recording.device, theta) for theta in recording.states[:, THETA]])
    rows = first[:, None] + np.arange(length)
    left = true[rows] - modelled
    basis = np.linalg.qr(np.stack([np.ones(length), np.arange(length, dtype=float)], axis=1))[0]
    left -= left @ basis @ basis.T
    return float(np.sqrt(np.mean(left**2)) / (known.resolution / math.sqrt(12.0)))
