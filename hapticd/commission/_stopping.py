"""How a current ends when nobody speaks any more, and how fast it comes when somebody does."""

from __future__ import annotations

import time
from math import exp, log
from typing import TYPE_CHECKING, Final

import numpy as np

from hapticd.commission.bench import constant, in_turn
from hapticd.commission.step import DisturbedError, Picture, Result, Seen, line, skipped
from hapticd.hil.injections import watchdog_s

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.commission.bench import Trace
    from hapticd.commission.rig import Rig
    from hapticd.config import Config

RUN_UP_S: Final = 0.04
"""How long the shaft is accelerated before nobody speaks any more."""
_HALVINGS: Final = 50
LATE: Final = 1.25
"""Longest time of a watchdog over what was asked of it."""
SILENT_TIMES: Final = 2.5
"""Times the watchdog's time after which it is dead."""
LOOP_SHARE: Final = 0.25
LOOP_S: Final = 0.02
LOOP_REPEATS: Final = 8
RESPONSE_TOLERANCE: Final = 0.2
GAIN_TOLERANCE: Final = 0.1


def driver_watchdog_s(config: Config) -> float | None:
    """The device's watchdog time, s; None where the driver has no such option."""
    if config.driver.name in ("serial_dac", "canopen"):
        return watchdog_s(config)
    given = config.driver.options.get("watchdog_ms")
    return 1e-3 * float(given) if given else None


def watchdog(rig: Rig) -> Result:
    """Accelerates the shaft gently, then says nothing more, and times when the device takes the current away by itself."""
    asked = driver_watchdog_s(rig.config)
    if asked is None:
        return skipped("this driver declares no watchdog: when the daemon dies, nobody takes the current away")
    current = gentle(rig)
    begun_ns = time.monotonic_ns()
    with rig.bench() as bench:
        trace = bench.run(in_turn(RUN_UP_S, current, None), RUN_UP_S + SILENT_TIMES * asked, may_fault=True)
    late_s = max(trace.worst_pause, rig.late_s(begun_ns))
    with rig.bench() as bench:  # anew: a device may take part in nothing more before it is brought up again
        stood = bench.rest()
    silent_from = float(np.nanmax(trace.sent))
    running = trace.part(RUN_UP_S / 2, trace.t[-1])
    moved = knee(running.t, running.position)
    if trace.code:  # it told us of its watchdog, and nothing more
        travel = (stood - int(trace.counts[-1])) * rig.config.raw_resolution
        moved = _end_of_push(
            running, travel, rig.sliding_current * float(rig.document("sign")["acceleration_per_ampere"])
        )
    gone = trace.t[~trace.enabled & (trace.t > silent_from)]
    told = float((trace.t[-1] if trace.code else gone[0]) - silent_from) if trace.code or len(gone) else None
    by_motion = None if moved is None else moved - silent_from
    figures = {
        "current_A": current,
        "zero_by_motion_ms": None if by_motion is None else 1e3 * by_motion,
        "off_by_status_ms": None if told is None else 1e3 * told,
        "asked_ms": 1e3 * asked,
    }
    most = LATE * asked + 3 * bench.period + 0.003
    limit = {"zero_by_motion_ms": 1e3 * most, "off_by_status_ms": 1e3 * most}
    picture = Picture(
        "s",
        "rad/s" if not rig.config.is_linear else "m/s",
        (line("speed", *_speed(trace)),),
        {"last command": silent_from, **({"zero current": moved} if moved else {})},
    )
    seen = Seen(figures, limit, picture, dangerous=True)
    late = [each for each in (by_motion, told) if each is None or each > most]
    if late:
        # by so much later a last command may have arrived, or an answer have been seen
        if late_s > (SILENT_TIMES - LATE if None in late else 0.25) * asked:
            raise DisturbedError(
                f"programs waited for {1e3 * late_s:.0f} ms while {1e3 * asked:.0f} ms of silence were timed"
            )
        when = "never" if None in late else f"after {1e3 * max(each for each in late if each is not None):.0f} ms"
        return seen.fails(
            f"{1e3 * SILENT_TIMES * asked:.0f} ms after the last command current still flows (zero: {when})"
            if None in late
            else f"zero current {when} of silence, {1e3 * asked:.0f} ms were asked for",
            "the device's watchdog is off, or is fed by something else than commands",
            "do not run a motor on this device before its watchdog works: driver.watchdog_ms, the device's own setting",
        )
    said = f"{1e3 * (by_motion or 0.0):.0f} ms by motion, {1e3 * (told or 0.0):.0f} ms by the device's status"
    return seen.passes(f"zero current after {said}")


def gentle(rig: Rig) -> float:
    """A current under which a sliding shaft accelerates gently, A."""
    return max(1.6 * rig.sliding_current, 0.01 * rig.rated)


def knee(t: NDArray[np.float64], position: NDArray[np.float64]) -> float | None:
    """When the acceleration became less, s: the best of two parabolas with one tangent where they meet.

    Args:
        t: (n,) s. position: (n,) rad or m, of a shaft that moves to the positive side until it stands.

    Returns:
        None where it did not become less, or there is too little motion.
    """
    moves = np.flatnonzero(np.diff(position) != 0)
    if len(moves) < 12 or position[-1] <= position[0]:
        return None
    t, position = t[: moves[-1]], position[: moves[-1]]
    best: tuple[float, float, float] | None = None
    for at in np.arange(t[4], t[-4], 0.0005):
        terms = np.column_stack([np.ones_like(t), t, t * t, np.maximum(t - at, 0.0) ** 2])
        solved, residual, *_ = np.linalg.lstsq(terms, position, rcond=None)
        error = float(residual[0]) if len(residual) else np.inf
        if best is None or error < best[0]:
            best = error, float(at), float(solved[3])
    return best[1] if best is not None and best[2] < 0 else None


def _end_of_push(trace: Trace, travel: float, braking: float) -> float | None:
    """When the push ended, s, where nothing was seen of it: from how far the shaft still went.

    Args:
        trace: of the push. travel: after its last sample, rad or m. braking: deceleration by friction, per s².
    """
    if len(trace.t) < 8:
        return None
    end = float(trace.t[-1])
    half, speed, _ = np.polyfit(trace.t - end, trace.position, 2)
    low, high = -end, 10.0 * end
    for _ in range(_HALVINGS):
        late = 0.5 * (low + high)
        reach = speed * late + half * late * late + max(speed + 2.0 * half * late, 0.0) ** 2 / (2.0 * braking)
        low, high = (late, high) if reach < travel else (low, late)
    return end + low


def _speed(trace: Trace, span: int = 6) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    t, position = trace.t, trace.position
    return 0.5 * (t[span:] + t[:-span]), (position[span:] - position[:-span]) / (t[span:] - t[:-span])


def current_loop(rig: Rig) -> Result:
    """Steps a quarter of the rated current to and fro for 20 ms, eight times, and looks at the measured current."""
    with rig.bench() as bench:
        if not np.isfinite(bench.run(constant(0.0), 0.01).measured).any():
            return skipped("this driver reports no measured current; identify sees the loop's lag in its delay")
        traces = []
        for n in range(LOOP_REPEATS):
            current = LOOP_SHARE * rig.rated * (1 if n % 2 == 0 else -1)
            traces.append((current, bench.run(in_turn(LOOP_S, current, -current, 0.0), 3 * LOOP_S)))
        bench.rest()
    after, response, settled = [], [], []
    for current, trace in traces:
        part = trace.part(0.0, LOOP_S)
        after += (part.t - part.sent[0]).tolist()
        response += (part.measured / current).tolist()
        settled += (part.measured[len(part.t) // 2 :] / current).tolist()
    known = np.isfinite(response)
    times, shares = np.array(after)[known], np.array(response)[known]
    kept = times > 0
    times, shares = times[kept], shares[kept]
    gain, lag = float(np.median(settled)), rig.declared_delay_s
    expected = 1.0 - np.exp(-times / max(lag, 1e-9))
    # one exchange after the command, two, three: in real time they do not come at the same instants in every repeat
    late = [
        expected[near] - shares[near] / (gain or 1.0)
        for k in (1, 2, 3)
        if (near := np.abs(times / bench.period - k) < 0.5).any()
    ]
    missing = max((float(np.median(each)) for each in late), default=0.0)
    first = times < 1.5 * bench.period
    at, arrived = (float(np.median(each[first])) for each in (times, shares))
    share = float(np.clip(arrived / (gain or 1.0), 0.001, 0.999))
    time_constant = at / -log(1.0 - share)
    figures = {
        "gain": gain,
        "response_after_first_period": arrived,
        "time_constant_ms": 1e3 * time_constant,
        "time_constant_declared_ms": 1e3 * lag,
        "is_upper_bound": share > 0.95,
    }
    limit = {
        "gain": f"{1 - GAIN_TOLERANCE:g} to {1 + GAIN_TOLERANCE:g}",
        "response_after_first_period": float(1.0 - exp(-at / max(lag, 1e-9))) - RESPONSE_TOLERANCE,
    }
    order = np.argsort(times)
    picture = Picture(
        "ms after the command",
        "measured over commanded",
        (
            line("measured", 1e3 * times[order], shares[order], "dots"),
            line("declared", 1e3 * times[order], expected[order]),
        ),
    )
    seen = Seen(figures, limit, picture)
    if abs(gain - 1.0) > GAIN_TOLERANCE:
        return seen.fails(
            f"{100 * gain:.0f} % of the commanded current is measured",
            "the current's scale in the drive or in the config, a limit in the drive, or a winding that is open",
            "the drive's rated current and limits, amplifier.dac_full_scale",
        )
    if missing > RESPONSE_TOLERANCE:
        return seen.fails(
            f"{1e3 * at:.2g} ms after the command {100 * arrived:.0f} % of the current are there: slower than declared",
            "the drive's current loop is tuned slow, filters its command, or amplifier.bandwidth_hz is too high",
            f"tune the current loop, or amplifier.bandwidth_hz: {0.7 / (np.pi * time_constant):.3g}",
        )
    word = "under" if figures["is_upper_bound"] else "about"
    said = f"time constant {word} {1e3 * time_constant:.2g} ms, {100 * gain:.0f} % arrives"
    return seen.passes(said)
