"""What a start or a live change would do: the servo loop itself, run ahead in virtual time on the config's own plant.

With limits and the heat of the winding, from where the shaft is, twice: left alone, through the soft start and a second
more; and held by a hand until the whole force is on, and then let go, which no soft start makes gentler. A trip there is
part of the stability guard's judgement, which knows whether a motion dies out, and not how large it is on the way
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
"""Of the motion of a shaft that is let go: its first swings are the largest, or theory has refused it."""
_CHUNK = 2048
_MOST_TICKS = 100_000
"""So that a long soft start at a high rate is no long wait."""
_HELD = ", held until the whole force is on and then let go,"
_TICKS_BEFORE = 3
"""Until the spring before is rendered, with its speed."""


@dataclass(frozen=True)
class Motion:
    """From where the loop runs ahead.

    Attributes:
        counts: of the encoder. speed: rad/s or m/s. i2t: the winding's excess, A² s.
        latency_s: of the driver, as it declares it.
        before: the config that is rendered, and its origin in counts; None where nothing is.
    """

    counts: int
    speed: float = 0.0
    i2t: float = 0.0
    latency_s: float = 0.0
    before: tuple[Config, int] | None = None


@dataclass(frozen=True)
class Prediction:
    """What would happen, and the trip that would end it.

    Attributes:
        stored_energy: largest potential of the whole spring on the way, J. peak_current: A. peak_speed: rad/s or m/s.
        excursion: farthest from the origin, rad or m.
        fault: number of the trip, 0 for none; with its value, the limit, and when, s after the start or the release.
        held: whether it is the shaft that was held and let go that trips.
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
        """It as data, for the guard's document."""
        return {
            "stored_energy_J": self.stored_energy,
            "peak_current_A": self.peak_current,
            "peak_speed": self.peak_speed,
            "excursion": self.excursion,
            "fault": faults.KINDS[self.fault].code if self.fault else None,
        }


def motion_of(rig: Rig) -> Motion:
    """Where the shaft of a rig is, how fast, and what holds it."""
    snapshot, is_rendered = rig.core.snapshot, rig.state == layout.RUNNING
    speed = float(snapshot["velocity"]) if is_rendered else 0.0
    before = (rig.config, rig.origin_counts) if is_rendered else None
    return Motion(rig.counts, speed, rig.core.i2t, rig.driver.latency_s, before)


def predict(config: Config, origin_counts: int, motion: Motion) -> Prediction:
    """Run the loop ahead.

    Args:
        config: to be put into force. origin_counts: of its spring, raw counts. motion: from where.
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
    """One of both, for so long after the soft start, if it has one."""
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
        # What comes after a trip is not what the spring does.
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
    """Of the whole spring at a place from its origin (rad or m), J."""
    bias = 0.5 if config.spring.half_tick_bias else 0.0
    scale = config.spring.stiffness * config.resolution**2
    return scale * float(spring_potential(place / config.resolution, bias, float(layout.SIDES[config.spring.side])))


def weigh(judgement: Judgement, prediction: Prediction, config: Config, force: bool) -> Judgement:
    """The guard's judgement with what the loop would do: a trip is refused, or overridden, as an unstable motion is.

    Args:
        judgement: what theory says; ``off`` stays so. prediction: of the same motion.
        config: its ``safety.guard`` is the policy. force: go on all the same.
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
