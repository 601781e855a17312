"""Prediction of a start or a live change: the servo loop itself runs in virtual time on the config's plant.

The simulation has all limits and the present I²t, and starts at the shaft's position. It has two cases: free, through the
soft start and a second more; and held by a hand until the full force is on, then released, where a soft start does not help.
A trip becomes part of the stability guard's judgement, which only decides whether a motion dies out, and not how large it is
(`docs/decisions/0071-soft-start.md`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.loopback import LoopbackDriver
from hapticd.config import Driver
from hapticd.record.schema import FLAG_FAULT
from hapticd.servo import atomics, faults, layout
from hapticd.servo.core import Request, ServoCore, parameters
from hapticd.stability.passivity import spring_potential

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.service.rig import Rig
    from hapticd.stability.guard import Judgement, Verdict

AFTERWARDS_S = 1.0
LET_GO_S = 0.5
"""Simulated time after a release [s]: the first swings are the largest, else theory has refused the motion."""
_CHUNK = 2048
_MOST_TICKS = 100_000
"""Bound on the duration of the simulation for a long soft start at a high rate."""
_HELD = ", held until the whole force is on and then let go,"
_TICKS_BEFORE = 3
"""Ticks until the previous spring is rendered, with a known speed."""


@dataclass(frozen=True)
class Motion:
    """Initial state of the prediction.

    Attributes:
        counts: of the encoder. speed: rad/s or m/s. i2t: of the winding, A² s.
        latency_s: declared by the driver.
        before: the rendered config and its origin in counts; None if no spring is rendered.
    """

    counts: int
    speed: float = 0.0
    i2t: float = 0.0
    latency_s: float = 0.0
    before: tuple[Config, int] | None = None


@dataclass(frozen=True)
class Prediction:
    """The predicted motion, and the trip that would end it.

    Attributes:
        stored_energy: largest potential energy of the spring, J. peak_current: A. peak_speed: rad/s or m/s.
        excursion: largest distance from the origin, rad or m.
        fault: number of the trip, 0 for none; with its value, its limit, and its time after the start or the release, s.
        held: whether the trip is in the case of the held shaft.
    """

    stored_energy: float
    peak_current: float
    peak_speed: float
    excursion: float
    fault: int = 0
    value: float = 0.0
    limit: float = 0.0
    after_s: float = 0.0
    held: bool = False

    @property
    def document(self) -> dict[str, Any]:
        """The prediction as data, for the guard's document."""
        return {
            "stored_energy_J": self.stored_energy,
            "peak_current_A": self.peak_current,
            "peak_speed": self.peak_speed,
            "excursion": self.excursion,
            "fault": faults.KINDS[self.fault].code if self.fault else None,
        }


def motion_of(rig: Rig) -> Motion:
    """Present position and speed of a rig's shaft, and the rendered spring."""
    snapshot, is_rendered = rig.core.snapshot, rig.state == layout.RUNNING
    speed = float(snapshot["velocity"]) if is_rendered else 0.0
    before = (rig.config, rig.origin_counts) if is_rendered else None
    return Motion(rig.counts, speed, rig.core.i2t, rig.driver.latency_s, before)


def predict(config: Config, origin_counts: int, motion: Motion) -> Prediction:
    """Predict both cases.

    Args:
        config: to be applied. origin_counts: of its spring, raw counts. motion: initial state.
    """
    alone = _run(config, Request(layout.RUNNING, origin_counts=origin_counts), motion, AFTERWARDS_S)
    if alone.fault or not config.safety.soft_start_s:
        return alone
    held = replace(motion, speed=0.0, before=None)
    let_go = _run(config, Request(layout.RUNNING, origin_counts=origin_counts, exact=True), held, LET_GO_S)
    return replace(
        let_go,
        stored_energy=max(alone.stored_energy, let_go.stored_energy),
        peak_current=max(alone.peak_current, let_go.peak_current),
        peak_speed=max(alone.peak_speed, let_go.peak_speed),
        excursion=max(alone.excursion, let_go.excursion),
        held=True,
    )


def _run(config: Config, request: Request, motion: Motion, seconds: float) -> Prediction:
    """Simulate one case, until `seconds` after the soft start, if it has one."""
    driver = LoopbackDriver(
        config.model_copy(update={"driver": Driver(name="loopback")}),
        position=(motion.counts + 0.5) * config.raw_resolution,
        velocity=motion.speed,
        enabled=True,
        latency_s=motion.latency_s,
    )
    driver.open()
    core = ServoCore(driver, ring_rows=_CHUNK, keep_truth=True, excitation_rows=1)
    if motion.before is not None:
        old, old_origin = motion.before
        core.publish(parameters(old, Request(layout.RUNNING, origin_counts=old_origin), latency_s=motion.latency_s))
        core.begin(0, layout.RUNNING)
        core.run(real_time=False, ticks=_TICKS_BEFORE)
    params = parameters(config, request, latency_s=motion.latency_s)
    core.publish(params)
    if motion.before is None:
        core.begin(0)
    core.memory["state"]["i2t"] = motion.i2t
    origin = int(params["origin"]) * config.raw_resolution
    wanted = math.ceil((seconds + (0.0 if request.exact else config.safety.soft_start_s)) * config.servo.rate_hz)
    left, current, speed = min(wanted + _TICKS_BEFORE, _MOST_TICKS), 0.0, 0.0
    nearest = farthest = motion.counts * config.raw_resolution - origin
    stored = _potential(config, nearest)
    while left > 0 and not core.load(atomics.FAULT_CODE):
        first = core.load(atomics.RING_HEAD)
        core.store(atomics.RING_TAIL, first)
        if core.run(real_time=False, ticks=min(left, _CHUNK)) == layout.RETURN_RUNAWAY:
            break
        done = core.load(atomics.RING_HEAD) - first
        taken = np.arange(first, first + done) & (_CHUNK - 1)
        # After a trip the motion is not that of the spring.
        taken = taken[: int(np.argmax(np.append(core.ring["flags"][taken] & FLAG_FAULT != 0, True))) + 1]
        if taken.size:
            away = core.truth[taken, 0] - origin
            nearest, farthest = min(nearest, float(away.min())), max(farthest, float(away.max()))
            speed = max(speed, float(np.abs(core.truth[taken, 1]).max()))
            current = max(current, float(np.abs(core.ring["current_command_A"][taken]).max()))
        left -= done
    number, (value, limit) = core.load(atomics.FAULT_CODE), core.fault_numbers
    return Prediction(
        stored_energy=max(stored, _potential(config, nearest), _potential(config, farthest)),
        peak_current=current,
        peak_speed=speed,
        excursion=max(abs(nearest), abs(farthest)),
        fault=number,
        value=value if number else 0.0,
        limit=limit if number else 0.0,
        after_s=core.load(atomics.FAULT_TICK) * config.period if number else 0.0,
    )


def _potential(config: Config, place: float) -> float:
    """Potential energy of the full spring at a distance from its origin (rad or m), J."""
    bias = 0.5 if config.spring.half_tick_bias else 0.0
    scale = config.spring.stiffness * config.resolution**2
    return scale * float(spring_potential(place / config.resolution, bias, float(layout.SIDES[config.spring.side])))


def weigh(judgement: Judgement, prediction: Prediction, config: Config, force: bool) -> Judgement:
    """Combine the guard's judgement with the prediction: a trip is refused, or overridden, like an unstable motion.

    Args:
        judgement: of the theory; ``off`` is not changed. prediction: of the same motion.
        config: its ``safety.guard`` is the policy. force: override a refusal.
    """
    if judgement.verdict == "off":
        return judgement
    judgement = replace(judgement, predicted=prediction.document)
    if not prediction.fault or judgement.verdict == "refused":
        return judgement
    cause = faults.describe(prediction.fault, prediction.value, prediction.limit, is_linear=config.is_linear)
    stiffness, energy = config.spring.stiffness, prediction.stored_energy
    unit = "N/m" if config.is_linear else "N m/rad"
    policy: Verdict = "warned" if config.safety.guard == "warn" else "forced" if force else "refused"
    return replace(
        judgement,
        verdict=policy,
        trips=True,
        reason=(
            f"{judgement.reason}; yet from where the shaft is{_HELD if prediction.held else ''} the loop, run ahead on the "
            f"model, trips {cause['code']} after {prediction.after_s:.3g} s: {cause['cause']}"
        ),
        help=(
            f"The spring stores {energy:.3g} J there with spring.stiffness = {stiffness:g} {unit} and asks for "
            f"{prediction.peak_current:.3g} A; bring origin and shaft nearer to each other, take a softer spring, or raise "
            "the limit."
        ),
    )
