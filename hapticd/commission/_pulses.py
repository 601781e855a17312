"""The first current: which way it turns the shaft and how hard, how long it takes, and what a known load needs."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, Final

import numpy as np

from hapticd.commission.bench import in_turn
from hapticd.commission.step import Picture, Result, Seen, StepError, line, skipped
from hapticd.config.text import significant

if TYPE_CHECKING:
    from hapticd.commission.bench import Sample, Trace
    from hapticd.commission.rig import Rig

PULSE_S: Final = 0.05
SHARES: Final = (0.01, 0.1, 0.2, 0.4)
"""Of the rated current: a hundredth first, in case the device takes it for another unit; more where nothing moves."""
MOVED_COUNTS: Final = 24
ACCELERATION_FACTOR: Final = 3.0
"""A config's inertia may be a guess by so much; a rating that is wrong is so by ten or a thousand."""
SHOTS: Final = 6
SHOT_S: Final = 0.015
DELAY_TOLERANCE_S: Final = 0.0008
"""What a motion seen through an encoder and timed by Python leaves open; `identify` knows it better."""
LIFT_HZ: Final = 4.0
LIFT: Final = 0.25
"""rad, or cm: how far a load is lifted and let down."""
LIFT_S: Final = 2.0
CONSTANT_TOLERANCE: Final = 0.1


def sign(rig: Rig) -> Result:
    """Gives a hundredth, then a tenth of the rated current for 50 ms, to one side and back; hands off."""
    config = rig.config
    expected = config.amplifier.torque_constant / config.plant.inertia
    slack = MOVED_COUNTS * config.raw_resolution
    with rig.bench() as bench:
        for share in SHARES:
            current = share * rig.rated

            def allowed(t: float, current: float = current) -> float:
                return slack + ACCELERATION_FACTOR * 0.5 * expected * current * t * t + slack

            trace = bench.run(in_turn(PULSE_S, current, 0.0), 2 * PULSE_S, travel=allowed)
            # what friction lets a hundredth do says which way; how much, the tenth
            moved = abs(trace.counts[-1] - trace.counts[0]) >= MOVED_COUNTS
            if moved and (share > SHARES[0] or trace.cut or trace.position[-1] < 0):
                break
            bench.rest()
        bench.rest()
        back = None
        if moved and not trace.cut:
            back = bench.run(in_turn(PULSE_S, -current, 0.0), 2 * PULSE_S, travel=allowed)
        bench.rest()
    driven, coasted = _accelerations(trace, PULSE_S)
    towards = np.sign(trace.position[-1])
    gain = towards * (abs(driven) + abs(coasted)) / current
    ratio = gain / expected
    figures = {
        "current_A": current,
        "counts": int(trace.counts[-1] - trace.counts[0]),
        "counts_back": None if back is None else int(back.counts[-1] - back.counts[0]),
        "acceleration_per_ampere": float(gain),
        "acceleration_per_ampere_expected": expected,
        "ratio": float(ratio),
        "friction_A": float(abs(coasted) / abs(gain)) if gain else None,
    }
    limit = {"ratio": f"{1 / ACCELERATION_FACTOR:.2g} to {ACCELERATION_FACTOR:g}", "counts": "positive"}
    seen = Seen(figures, limit, _pulse_picture(trace, config.raw_resolution), dangerous=True)
    if not moved:
        return seen.fails(
            f"nothing moves up to {current:.3g} A, {100 * SHARES[-1]:.0f} % of the rated current",
            "a motor lead is off, the amplifier gives no current, the brake is on, or friction holds the shaft",
            "the motor's leads and the amplifier's output with a meter",
        )
    if towards < 0:
        return seen.fails(
            f"positive current turns the shaft backwards ({figures['counts']} counts at {current:.3g} A)",
            "the motor's two leads are exchanged: the spring would push away from its origin, and run away",
            "exchange the motor's leads; the encoder is right, as the step before has shown",
        )
    if trace.cut or ratio > ACCELERATION_FACTOR:
        return seen.fails(
            f"{current:.3g} A accelerate the shaft {significant(ratio)} times as much as the config says",
            "the device takes the command for another unit or has another rated current; or the config's inertia is far off",
            "the drive's rated current and unit of the command, amplifier.dac_full_scale, plant.inertia",
        )
    if ratio < 1.0 / ACCELERATION_FACTOR:
        return seen.fails(
            f"{current:.3g} A accelerate the shaft {significant(ratio)} times as much as the config says",
            "less current flows than is commanded, or more is moved than the config knows",
            "the drive's rated current and unit of the command, amplifier.dac_full_scale, plant.inertia",
        )
    if back is None or back.counts[-1] >= back.counts[0]:
        return seen.fails(
            "negative current does not turn the shaft back",
            "the amplifier drives one way only",
            "the amplifier's mode and enable inputs",
        )
    said = f"positive current counts up; {significant(ratio)} times the acceleration that the config expects"
    return seen.passes(said)


def delay(rig: Rig) -> Result:
    """Gives six pulses of 15 ms, each braked by its opposite, and times when the motion begins."""
    config = rig.config
    current = min(0.8 * rig.rated, 8.0 * rig.sliding_current)
    found, picture = [], None
    with rig.bench() as bench:
        for shot in range(SHOTS):
            sided = current * (1 if shot % 2 == 0 else -1)
            trace = bench.run(in_turn(SHOT_S, sided, -sided, 0.0), 4 * SHOT_S, travel=2 * pi)
            found.append(_onset(trace, config.raw_resolution))
            picture = picture or _pulse_picture(trace.part(0.0, SHOT_S), config.raw_resolution)
            bench.rest()
    known = [each for each in found if each is not None]
    if len(known) < SHOTS // 2:
        return skipped("the pulses moved the shaft by too few counts to time them; identify measures the delay")
    measured, declared = float(np.median(known)), rig.declared_delay_s
    figures = {"delay_us": 1e6 * measured, "declared_us": 1e6 * declared, "shots": len(known)}
    most = declared + max(DELAY_TOLERANCE_S, 0.5 * bench.period)
    seen = Seen(figures, {"delay_us": 1e6 * most}, picture)
    if measured > most:
        return seen.fails(
            f"the motion begins {1e3 * measured:.2g} ms after the command, {1e3 * declared:.2g} ms are declared",
            "a filter, a ramp or a buffer in the drive, or a driver that is slower than it says",
            f"switch the drive's filters off, or declare it: driver.latency_s: {np.ceil(1e5 * measured) * 1e-5:.5f}",
        )
    return seen.passes(f"{1e6 * measured:.0f} µs from command to motion")


def known_load(rig: Rig) -> Result:
    """Holds a weight that you hang on, lifts it by a quarter of a radian (2.5 mm) in 2 s and lets it down again."""
    config, load = rig.config, rig.given.load
    if load is None:
        return skipped("no known weight or spring was given (--weight and --arm, or --torque)")
    constant_given = config.amplifier.torque_constant
    holding = load / constant_given
    if holding > rig.rated:
        return skipped(
            f"holding {load:.3g} takes {holding:.3g} A, more than the rated {rig.rated:.3g} A: a smaller one"
        )
    if not rig.operator.does("Hang the weight on so that it pulls against positive motion, and let go after Enter"):
        return skipped("nobody was there to hang the weight on")
    gain = float(rig.results["sign"].figures["acceleration_per_ampere"])
    lift = LIFT * (0.01 if config.is_linear else 1.0)
    with rig.bench() as bench:
        rule = _Lifting(gain, holding, lift)
        trace = bench.run(rule, 3 * LIFT_S, travel=10 * lift, hand=lambda t: -load)
    if trace.cut:
        raise StepError("the load ran away: it is far from what was given, or the torque constant is")
    up, down = (trace.part((n + 0.4) * LIFT_S, (n + 1) * LIFT_S) for n in (1, 2))
    means = [float(part.command.mean()) for part in (up, down)]
    carried = 0.5 * sum(means)
    measured = load / carried if carried > 0 else float("inf")
    ratio = constant_given / measured
    figures = {
        "torque_constant": measured,
        "torque_constant_config": constant_given,
        "ratio": ratio,
        "up_A": means[0],
        "down_A": means[1],
    }
    limit = {"ratio": f"{1 - CONSTANT_TOLERANCE:g} to {1 + CONSTANT_TOLERANCE:g}"}
    picture = Picture("s", "A", (line("current", trace.t, trace.command),), {"up": LIFT_S, "down": 2 * LIFT_S})
    seen = Seen(figures, limit, picture)
    if abs(ratio - 1.0) > CONSTANT_TOLERANCE:
        return seen.fails(
            f"the load needs {carried:.3g} A: a torque constant of {measured:.4g}, the config has {constant_given:.4g}",
            "the constant of another winding or in another unit, or a current that is not what the drive says",
            f"amplifier.torque_constant: {measured:.4g}, if the weight and the arm are right",
        )
    said = f"torque constant {measured:.4g}, {significant(ratio)} of it in the config"
    return seen.passes(said)


class _Lifting:
    """A slow position loop: hold, go up by so much, and down again."""

    def __init__(self, gain: float, holding: float, lift: float) -> None:
        w = 2.0 * pi * LIFT_HZ
        self._stiff, self._slow, self._lift = w * w / gain, w / 3.0, lift
        self._damped = 2.0 * w / gain
        self._integral, self._last = holding, (0.0, 0.0)

    def __call__(self, sample: Sample) -> float:
        t, dt = sample.t, max(sample.t - self._last[0], 1e-4)
        up = np.clip((t - LIFT_S) / LIFT_S, 0.0, 1.0) - np.clip((t - 2 * LIFT_S) / LIFT_S, 0.0, 1.0)
        error = self._lift * float(up) - sample.travel
        speed = (sample.travel - self._last[1]) / dt
        self._integral += self._stiff * self._slow * error * dt
        self._last = (t, sample.travel)
        return self._integral + self._stiff * error - self._damped * speed


def _accelerations(trace: Trace, pulse_s: float) -> tuple[float, float]:
    """Under current and coasting, rad/s² or m/s²; 0 where there is nothing to be seen."""
    found = []
    for part in (trace.part(0.1 * pulse_s, pulse_s), trace.part(1.05 * pulse_s, 2 * pulse_s)):
        moving = np.concatenate([[False], np.diff(part.position) != 0])
        if trace.cut:
            part = trace
            moving = np.ones(len(trace.t), bool)
        if moving.sum() < (3 if trace.cut else 8):
            found.append(0.0)
            continue
        end = int(np.flatnonzero(moving)[-1]) + 1
        found.append(float(2.0 * np.polyfit(part.t[:end], part.position[:end], 2)[0]))
    return found[0], 0.0 if trace.cut else found[1]


def _onset(trace: Trace, resolution: float) -> float | None:
    """When the motion began, s after the first command: x = ½ a (t − t₀)², and a count is seen half a count late."""
    part = trace.part(0.0, SHOT_S)
    travel = np.abs(part.position) + 0.5 * resolution
    seen = (travel > 4 * resolution) & (part.t > 0)
    if seen.sum() < 4:
        return None
    slope, height = np.polyfit(part.t[seen], np.sqrt(travel[seen]), 1)
    return float(-height / slope - trace.sent[0])


def _pulse_picture(trace: Trace, resolution: float) -> Picture:
    counts = trace.position / resolution
    scale = max(1.0, float(np.abs(counts).max(initial=1.0))) / max(float(np.abs(trace.command).max(initial=0.0)), 1e-9)
    return Picture(
        "s",
        "counts",
        (
            line("encoder", trace.t, counts, "dots"),
            line(f"command, 1 A = {significant(scale)}", trace.t, scale * trace.command, "steps"),
        ),
    )
