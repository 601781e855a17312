"""Before anything moves by itself: the machine and the config, zero current, and the shaft turned by hand."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapticd.commission.bench import constant
from hapticd.commission.step import Picture, Result, Seen, line, skipped
from hapticd.config.limits import limits_off
from hapticd.config.text import significant
from hapticd.doctor import examine
from hapticd.doctor.finding import Level
from hapticd.plant.hand import turning_force

if TYPE_CHECKING:
    from hapticd.commission.bench import Bench, Sample, Trace
    from hapticd.commission.rig import Rig
    from hapticd.config import Config

NEEDED: Final = (
    "amplifier.continuous_current",
    "amplifier.peak_current",
    "safety.max_velocity",
    "safety.max_excursion",
)
"""Limits without which nothing is moved."""
QUIET_S: Final = 1.5
TURN_S: Final = 30.0
"""How long the hand may take."""
STILL_S: Final = 1.0
"""The hand has let go when nothing has moved for so long."""
TURN_TOLERANCE: Final = 0.12
"""Of a turn: nobody turns a shaft to its mark exactly."""
RATIOS: Final = (0.1, 0.125, 0.25, 0.5, 2.0, 4.0, 8.0, 10.0)
"""What a resolution is usually wrong by: lines for counts, another decoding, another interpolation."""


def look_at_machine(rig: Rig) -> Result:
    """Looks whether this machine and its ports are fit, and the config has the limits of a safe motion; nothing moves."""
    found = examine(rig.config)
    off = [key for key in limits_off(rig.config) if key in NEEDED]
    figures = {"bad": found.named(Level.BAD), "note": found.named(Level.NOTE)}
    if off:
        return Seen(figures, {"needed": ", ".join(NEEDED)}, dangerous=True).fails(
            f"the config leaves out {', '.join(off)}: nobody knows what a small current or a small motion is",
            "a limit that is 0 or null is none",
            "set them from the motor's data sheet and the room that the rig has, then begin again",
        )
    seen = Seen(figures, {"bad": "none"})
    if not found.fit:
        worst = next(finding for finding in found.findings if finding.level is Level.BAD)
        return seen.fails(found.verdict, f"{worst.name}: {worst.found}", worst.fix)
    return seen.passes(found.verdict)


def hold_zero(rig: Rig) -> Result:
    """Switches the amplifier on at zero current for 1.5 s; the shaft should stand where it is."""
    with rig.bench() as bench:
        trace = bench.run(constant(0.0), QUIET_S, travel=_turn(rig.config) / 2)
    travel = int(np.ptp(trace.counts))
    flowing = float(np.mean(trace.measured)) if np.isfinite(trace.measured).any() else None
    allowed = max(4, round(0.002 * _counts_a_turn(rig.config)))
    most = 0.02 * rig.rated
    figures = {"travel_counts": travel, "measured_A": flowing, "on_s": float(trace.t[-1])}
    limit = {"travel_counts": allowed, "measured_A": most}
    picture = Picture("s", "counts", (line("encoder", trace.t, trace.counts, "steps"),))
    seen = Seen(figures, limit, picture, dangerous=travel > allowed)
    if travel > allowed:
        return seen.fails(
            f"the shaft moves by {travel} counts though no current is asked for",
            "an offset of the amplifier above friction, a load that pulls, or noise on the encoder's lines",
            "trim the amplifier's offset; hold a rig that would fall; look at the encoder's shield and supply",
        )
    if flowing is not None and abs(flowing) > most:
        return seen.fails(
            f"{flowing:.3g} A flow though none is asked for",
            "an offset of the current's measurement or of the amplifier",
            "have the amplifier zero itself, or trim it",
        )
    said = "" if flowing is None else f", {1e3 * flowing:.2g} mA measured"
    return seen.passes(f"the shaft stands{said}")


def turn_by_hand(rig: Rig) -> Result:
    """Asks you to turn the shaft to and fro at zero current; watches direction, resolution, jumps, index and friction."""
    config = rig.config
    turn = _turn(config)
    what = "by 10 mm" if config.is_linear else "by exactly one turn, to the mark where it was"
    with rig.bench() as bench:
        traces = []
        for direction, where in ((1, "in the direction that you call positive"), (-1, "back to where it was")):
            if not rig.operator.does(f"Move the shaft {what}, {where}, then let go. It has {TURN_S:g} s from Enter"):
                return skipped("nobody was there to turn the shaft")
            traces.append(_turned(bench, config, direction * turn))
            bench.rest()
        reports = bench.driver.reports_index
    there, back = traces
    travel = int(there.counts[-1] - there.counts[0])
    # a bit of a turn may be lost or won without anybody's fault, half of one is a question of what a turn is
    figures: dict[str, Any] = {
        "counts": travel,
        "counts_expected": round(_counts_a_turn(config)),
        "counts_after_return": int(back.counts[-1] - there.counts[0]),
        "largest_step_counts": int(np.abs(np.diff(np.concatenate([there.counts, back.counts]))).max(initial=0)),
        "coasting_deceleration": _coasting(there),
        "coasting_deceleration_config": config.plant.coulomb / config.plant.inertia,
        "index_pulses": int(back.index_seen[-1] - there.index_seen[0]) if reports else None,
    }
    limit = {
        "counts": f"{1 - TURN_TOLERANCE:g} to {1 + TURN_TOLERANCE:g} of what is expected",
        "counts_after_return": round(TURN_TOLERANCE * _counts_a_turn(config)),
        "largest_step_counts": config.safety.encoder_jump,
        "index_pulses": "1 at least" if reports else "this driver reports no index",
    }
    fault = _what_is_wrong(figures, reports, config) or _index_distance(there, back, figures, config)
    lines = line("forwards", there.t, there.counts), line("back", there.t[-1] + back.t, back.counts)
    # which way is positive decides what the sign of the motor is compared with
    seen = Seen(figures, limit, Picture("s", "counts", lines), dangerous=True)
    if fault:
        return seen.fails(*fault)
    index = f"{figures['index_pulses']} index pulses" if reports else "this driver reports no index"
    return seen.passes(f"{travel:+d} counts for one turn, {index}")


def _what_is_wrong(figures: dict[str, Any], reports: bool, config: Config) -> tuple[str, str, str] | None:
    counts, expected = figures["counts"], figures["counts_expected"]
    key = "counts_per_metre" if config.is_linear else "counts_per_rev"
    if abs(counts) < 0.01 * expected:
        return (
            f"the counter moved by {counts} counts while the shaft was turned once",
            "nobody turned it, the encoder has no supply, or one of its channels is dead",
            "supply, A and B on a scope; then this step again",
        )
    if counts < 0:
        return (
            f"a positive turn counts down ({counts})",
            "A and B of the encoder are exchanged",
            f"exchange A and B, or set encoder.invert: {str(not config.encoder.invert).lower()}",
        )
    ratio = counts / expected
    if abs(ratio - 1.0) > TURN_TOLERANCE:
        near = min(RATIOS, key=lambda each: abs(np.log(ratio / each)))
        usual = abs(ratio / near - 1.0) < TURN_TOLERANCE
        said = f"{significant(near)} times" if usual else f"{significant(ratio)} times"
        given = config.encoder.counts_per_metre or config.encoder.counts_per_rev or 0.0
        return (
            f"one turn is {counts} counts, {said} what encoder.{key} says",
            "lines were taken for counts (four to a line), another decoding or interpolation is set",
            f"set encoder.{key}: {given * (near if usual else ratio):g}, or the encoder's decoding",
        )
    if config.safety.encoder_jump and figures["largest_step_counts"] > config.safety.encoder_jump:
        return (
            f"the counter jumped by {figures['largest_step_counts']} counts from one sample to the next",
            "the wrap of the device's counter is not removed, or noise counts",
            "the counter's width in the device's config; the encoder's shield",
        )
    if abs(figures["counts_after_return"]) > TURN_TOLERANCE * expected:
        return (
            f"back at the mark the counter is off by {figures['counts_after_return']} counts",
            "edges are lost: a channel that is weak, or a counter that is too slow",
            "A and B on a scope while the shaft turns",
        )
    if reports and figures["index_pulses"] == 0:
        return (
            "no index pulse in one turn there and back",
            "the index is not connected, or the encoder has none",
            "wire the index, or set the driver's index off where the encoder has none",
        )
    return None


def _index_distance(there: Trace, back: Trace, figures: dict[str, Any], config: Config) -> tuple[str, str, str] | None:
    """Index pulses that are not a turn apart say what a turn is without anybody's mark."""
    every = _counts_a_turn(config)
    seen = [trace.index_counts[trace.index_seen > there.index_seen[0]] for trace in (there, back)]
    places = np.unique(np.concatenate(seen))
    figures["index_places"] = places.tolist()[:8]
    wrong = [place for place in np.diff(places) if abs(place / every - round(place / every)) > 0.01]
    if not figures["index_pulses"] or not wrong:
        return None
    return (
        f"index pulses are {wrong[0]} counts apart, and a turn should have {every:.0f}",
        "the resolution is another, or noise on the index line",
        "encoder.counts_per_rev; the index line's shield",
    )


def _turned(bench: Bench, config: Config, travel: float) -> Trace:
    """One movement of the hand, until nothing has moved for a while."""
    moved: list[tuple[float, float]] = []

    def let_go(sample: Sample) -> bool:
        if not moved or abs(sample.travel - moved[-1][1]) > 2 * config.raw_resolution:
            moved.append((sample.t, sample.travel))
        return abs(moved[-1][1]) > 0.02 * abs(travel) and sample.t - moved[-1][0] > STILL_S

    hand = None
    if bench.hand_is_simulated:
        force, seconds = turning_force(bench.driver.device, travel)  # type: ignore[attr-defined]
        hand = lambda t: force if t < seconds else 0.0  # noqa: E731
    return bench.run(constant(0.0), 4.0 if hand else TURN_S, hand=hand, until=let_go)


def _coasting(trace: Trace) -> float | None:
    """How fast the shaft slowed down once it was let go, rad/s² or m/s²: from where it was fastest until it stood."""
    span = 10
    speed = np.abs(trace.position[span:] - trace.position[:-span])
    start = int(np.argmax(speed)) + span
    end = start + int(np.argmax(speed[start - span :] == 0)) if (speed[start - span :] == 0).any() else len(trace.t)
    if end - start < 2 * span:
        return None
    late = slice(start, end - span)
    return float(abs(2.0 * np.polyfit(trace.t[late], trace.position[late], 2)[0])) if end - span - start > 4 else None


def _turn(config: Config) -> float:
    return 0.01 if config.is_linear else 2.0 * pi


def _counts_a_turn(config: Config) -> float:
    return _turn(config) / config.raw_resolution
