"""``simulate``: the servo loop and the plant in virtual time, as fast as the machine allows and repeatable to the bit."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numba
import numpy as np

from drivers import declared_latency
from drivers.loopback import LoopbackDriver
from hapticd.config import Driver
from hapticd.jit import njit
from hapticd.record.schema import ROW, joined
from hapticd.servo import atomics, faults, layout
from hapticd.servo.core import Request, ServoCore, parameters
from hapticd.stability.numbers import loop_from_config
from hapticd.stability.outcome import Outcome, OutcomeTracker
from hapticd.stability.sampled_loop import can_rest
from hapticd.stability.whole_loop import energy, record_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.config import Config

_CHUNK = 1 << 14

_ROWS = numba.types.Array(numba.from_dtype(ROW), 1, "C")
_STATES = numba.types.Array(numba.float64, 2, "C")
_f8 = numba.float64


@njit(_f8(_ROWS), counted=False)
def _largest_current(rows: NDArray[Any]) -> float:
    """Largest command of either sign, A."""
    largest = 0.0
    for k in range(len(rows)):
        largest = max(largest, abs(rows[k].current_command_A))
    return largest


@njit(numba.void(_STATES, _f8, _f8, _f8, _f8, _f8, numba.float64[::1]), counted=False)
def _energies(
    truth: NDArray[Any], origin: float, resolution: float, period: float, mu: float, kappa: float, out: NDArray[Any]
) -> None:
    """H_T (35) of true states (n, 2), see `hapticd.stability.storage.storage`, into ``out`` (n,)."""
    for k in range(len(truth)):
        xi, xi_dot = (truth[k, 0] - origin) / resolution, truth[k, 1] * (period / resolution)
        out[k] = energy(xi, xi_dot, mu) + 0.5 * kappa * xi * xi


_PEAK, _FASTEST, _MOVED, _DIRECTION, _TURNS, _FIRST_TURN = range(6)
_KEPT_TURNS = 32


@njit(numba.void(_STATES, _f8, _f8, numba.float64[::1]), counted=False)
def _follow(truth: NDArray[Any], origin: float, done: float, motion: NDArray[Any]) -> None:
    """Update the summary of a motion; ``motion`` is indexed by the names above and ends with the ticks of the last turns."""
    for k in range(len(truth)):
        speed = truth[k, 1]
        motion[_PEAK] = max(motion[_PEAK], abs(truth[k, 0] - origin))
        motion[_FASTEST] = max(motion[_FASTEST], abs(speed))
        if speed != 0.0:
            motion[_MOVED] = done + k + 1
            direction = 1.0 if speed > 0.0 else -1.0
            if direction == -motion[_DIRECTION]:
                motion[_FIRST_TURN + int(motion[_TURNS]) % _KEPT_TURNS] = done + k
                motion[_TURNS] += 1
            motion[_DIRECTION] = direction


def _described(motion: NDArray[np.float64], period: float, at_rest: bool) -> dict[str, float | None]:
    """The motion in SI units."""
    kept = np.sort(motion[_FIRST_TURN:][: int(motion[_TURNS])])
    swings = 0.5 * (kept.size - 1)
    return {
        "peak_deflection": float(motion[_PEAK]),
        "peak_velocity": float(motion[_FASTEST]),
        "time_to_rest_s": float(motion[_MOVED]) * period if at_rest else None,
        "frequency_hz": float(swings / ((kept[-1] - kept[0]) * period)) if kept.size > 2 else None,
    }


def simulate(
    config: Config,
    duration_s: float,
    *,
    deflection: float | None = None,
    velocity: float | None = None,
    safety: bool = False,
    seed: int | None = None,
    energies: bool = True,
    excitation: NDArray[np.float64] | None = None,
    replay: NDArray[np.int64] | None = None,
    on_rows: Callable[[NDArray[Any]], None] | None = None,
    on_truth: Callable[[NDArray[np.float64]], None] | None = None,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Simulate ``duration_s`` of the running loop with the config's plant model.

    Args:
        config: any configuration; the loopback replaces its driver, with the declared latency of that driver.
        duration_s: virtual time in s, rounded to whole periods.
        deflection: true initial position in coarse ticks from the spring's origin (default 0).
        velocity: true initial velocity in coarse ticks per period (default 0).
        safety: with the trips and the clamp at the peak current; otherwise only the DAC limits the current.
        seed: seed of the dither, instead of the config's.
        energies: compute the energy, from which the outcome follows; without it the outcome is None.
        excitation: table of an identification experiment (:func:`hapticd.servo.excitation.build`), played from the start;
            shape (2, ticks of the table).
        replay: tick numbers and lateness in ns of a recorded loop, shape (2, n), to repeat its timing from the
            first one on; ``duration_s`` is then not used.
        on_rows: called with every block of rows, in order.
        on_truth: called with the true (position, velocity) at those rows, (n, 2), rad or m and per s.
        progress: called with the fraction done.

    Returns:
        The JSON keys of ``hapticd simulate --json``.

    Raises:
        ValueError: the duration is shorter than one period.
    """
    ticks = round(duration_s * config.servo.rate_hz) if replay is None else replay.shape[1]
    ticks_of = (
        None if replay is None else np.stack([np.diff(replay[0], prepend=replay[0, 0] - 1) - 1, replay[1]], axis=1)
    )
    if ticks < 1:
        raise ValueError(f"a duration of {duration_s:g} s is shorter than one servo period")
    if seed is not None:
        config = config.model_copy(update={"dither": config.dither.model_copy(update={"seed": seed})})
    resolution, period = config.resolution, config.period
    origin = config.origin_counts * config.raw_resolution
    start = origin + (deflection or 0.0) * resolution, (velocity or 0.0) * resolution / period
    driver, core, warnings = _begun(config, start, safety, excitation)

    inertia = config.plant.inertia + config.hand.inertia
    mu = inertia / (config.spring.stiffness * period**2) if config.spring.stiffness else 0.0
    kappa = config.hand.stiffness / config.spring.stiffness if config.spring.stiffness else 0.0
    tracker = OutcomeTracker() if mu and energies else None
    stored, motion = np.zeros(_CHUNK), np.zeros(_FIRST_TURN + _KEPT_TURNS)
    done, reason, spent, peak = 0, layout.RETURN_TICKS, 0.0, 0.0
    wall = time.perf_counter()
    while done < ticks and reason == layout.RETURN_TICKS:
        count = min(_CHUNK, ticks - done)
        begin = time.perf_counter()
        reason = (
            core.run(real_time=False, ticks=count) if ticks_of is None else _replay(core, ticks_of[done : done + count])
        )
        # The ring is as long as a chunk, so that these rows begin at its beginning.
        head = core.load(atomics.RING_HEAD)
        core.store(atomics.RING_TAIL, head)
        rows, truth = core.ring[: head - done], core.truth[: head - done]
        if on_rows is not None or on_truth is not None:
            rows, truth = joined(rows), truth.copy()
        if tracker is not None:
            _energies(truth, origin, resolution, period, mu, kappa, stored)
            tracker.update(stored[: len(truth)])
        if energies:
            _follow(truth, origin, done, motion)
        peak = max(peak, _largest_current(rows))
        spent += time.perf_counter() - begin
        done += len(rows)
        if on_rows is not None:
            on_rows(rows)
        if on_truth is not None:
            on_truth(truth)
        if progress is not None:
            progress(done / ticks)
    final_ns, final_frac = core.next_instant()
    position, speed = driver.true_state(final_ns, final_frac)
    at_rest = driver.stays_at_rest()
    number = core.load(atomics.FAULT_CODE)
    report: dict[str, Any] = {
        "ticks": done,
        "wall_s": time.perf_counter() - wall,
        "ticks_per_s": done / spent if spent > 0 else None,
        "outcome": tracker and _outcome(config, tracker.outcome(at_rest, reason == layout.RETURN_RUNAWAY), at_rest),
        "final": {
            "position_ticks": (position - origin) / resolution,
            "velocity_ticks_per_period": speed * period / resolution,
            "position": position - origin,
            "velocity": speed,
        },
        "motion": _described(motion, period, at_rest) if energies else None,
        "at_rest": at_rest,
        "peak_current_A": peak,
        "warnings": [*warnings, *_too_much(config, peak)],
        "fault": _fault(core, config, number) if number else None,
    }
    if config.safety.passivity != "off":
        report["passivity"] = core.passivity()
    return report


def _begun(
    config: Config, start: tuple[float, float], safety: bool, excitation: NDArray[np.float64] | None
) -> tuple[LoopbackDriver, ServoCore, list[str]]:
    """The device at its start (position, velocity), the loop that renders on it, and warnings about the device's delay."""
    latency_s, doubt = declared_latency(config)
    loopback = config.model_copy(update={"driver": Driver(name="loopback")})
    driver = LoopbackDriver(
        loopback, position=start[0], velocity=start[1], enabled=True, limited=safety, latency_s=latency_s
    )
    driver.open()
    table = np.zeros((2, 1)) if excitation is None else excitation
    core = ServoCore(driver, ring_rows=_CHUNK, keep_truth=True, excitation_rows=table.shape[1])
    core.excitation[:] = table
    played = Request(state=layout.RUNNING, excitation_id=1, excitation_length=table.shape[1])
    request = Request(state=layout.RUNNING) if excitation is None else played
    core.publish(parameters(config, request, safety=safety, latency_s=latency_s))
    core.begin(0, layout.RUNNING)
    return driver, core, [doubt] if doubt else []


def _too_much(config: Config, peak: float) -> list[str]:
    limit = config.amplifier.peak_current
    if not limit or peak <= limit:
        return []
    said = f"the requested current reached {peak:.4g} A, above amplifier.peak_current = {limit:g} A"
    return [f"{said}; --safety simulates this limit"]


def _replay(core: ServoCore, ticks: NDArray[np.int64]) -> int:
    """Repeat recorded ticks, (n, 2): periods skipped before each, and its lateness in ns; returns a RETURN_* reason."""
    reason = layout.RETURN_TICKS
    for skipped, late_ns in ticks:
        core.replay(int(skipped), int(late_ns))
        if (reason := core.run(real_time=False, ticks=1)) != layout.RETURN_TICKS:
            break
    return reason


def _outcome(config: Config, outcome: Outcome, at_rest: bool) -> Outcome:
    """The outcome; if Coulomb friction holds no force that the loop commands, a decaying motion is persistent."""
    if outcome != "decaying" or at_rest or config.plant.effects:
        return outcome
    return outcome if can_rest(record_of(config, loop_from_config(config))[0]) else "persistent"


def _fault(core: ServoCore, config: Config, number: int) -> dict[str, Any]:
    value, limit = core.fault_numbers
    described = faults.describe(number, value, limit, is_linear=config.is_linear)
    return {**described, "tick": core.load(atomics.FAULT_TICK)}
