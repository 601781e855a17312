"""What a stranger has of a motion: a text file with what is wrong with it, and the map that says which column is what."""

from __future__ import annotations

import io
import math
from typing import Any, NamedTuple

import numpy as np
import yaml

from benchmarks.gap.foreign.machines import Drawn, Rng, between
from benchmarks.gap.foreign.simulate import Floats, Motion

FAULTS = {
    "none": "the command, at every period of the controller",
    "device_delay": "the same; the device answers late, by a delay or a lag of its current loop",
    "late_current": "the current as measured at the stamp, or 1 to 2 samples before",
    "filtered_current": "the current behind a filter of 1 to 8 samples",
    "stale": "positions half a sample to two samples old",
    "unsynchronised": "positions of a clock of their own, held",
    "rounded_stamps": "stamps of whole ms (10 ms below 100 Hz) of a rate that is not whole",
    "few_digits": "stamps as float32 of a clock that has run for long",
    "uneven": "uneven stamps, rows that lack, a controller with a clock of its own",
    "sampled": "the command of a controller that is faster than the record",
}
MEASURED = ("late_current", "filtered_current")
_AGES = (0.5, 1.0, 1.5, 2.0)
_OWN_CLOCK = ("uneven", "sampled")


class Rows(NamedTuple):
    """The columns of a file; all of shape (n,)."""

    stamp: Floats
    position: Floats
    current: Floats


def broken(drawn: Drawn, fault: str, rng: Rng) -> Drawn:
    """The machine as it is where a fault is more than a way to write."""
    machine, loop, period_s = drawn.machine, drawn.loop, 1.0 / drawn.rate_hz
    if fault == "rounded_stamps":
        return drawn._replace(tick_s=1.003 * drawn.tick_s, rate_hz=drawn.rate_hz / 1.003)
    if fault == "device_delay" and rng.random() < 0.5:
        return drawn._replace(loop=loop._replace(delay=math.ceil(loop.every * rng.uniform(0.8, 3.0))))
    if fault == "device_delay":
        return drawn._replace(machine=machine._replace(current_lag_s=period_s * between(rng, 1.0, 4.0)))
    if fault == "late_current":
        return drawn._replace(machine=machine._replace(current_lag_s=period_s * rng.uniform(0.02, 0.2)))
    if fault == "filtered_current":
        return drawn._replace(machine=machine._replace(report_lag_s=period_s * between(rng, 1.0, 8.0)))
    return drawn._replace(loop=loop._replace(every=1)) if fault in _OWN_CLOCK else drawn


def recorded(drawn: Drawn, motion: Motion, fault: str, rng: Rng) -> Rows:
    """What the file holds, in SI units."""
    period_s, tick_s = 1.0 / drawn.rate_hz, drawn.tick_s
    ticks = np.arange(motion.position.size) * tick_s
    instants = np.arange(3, math.floor(ticks[-1] / period_s) - 1) * period_s
    if fault == "uneven":
        late = np.minimum(rng.exponential(rng.uniform(0.03, 0.15), instants.size), 0.8)
        instants = (instants + period_s * late)[rng.random(instants.size) > rng.choice([0.0, 0.005])]
    stamps = instants.copy()
    if fault == "stale":
        instants = instants - period_s * rng.choice(_AGES)
    elif fault == "unsynchronised":
        own = period_s * rng.uniform(0.6, 1.2)
        instants = np.floor(instants / own) * own
    position = np.floor(_between(ticks, motion, instants) / drawn.machine.resolution)
    return Rows(_stamped(stamps, period_s, fault, rng), position, _current(drawn, motion, stamps, fault, rng))


def _current(drawn: Drawn, motion: Motion, stamps: Floats, fault: str, rng: Rng) -> Floats:
    row = np.floor(stamps / drawn.tick_s + 1e-6).astype(np.int64)
    if fault not in MEASURED:
        return np.asarray(motion.command[row])
    if fault == "late_current":
        row -= round(float(rng.choice([0.0, 0.0, 1.0, 2.0])) / (drawn.rate_hz * drawn.tick_s))
        found = motion.current[row]
    else:
        found = motion.reported[row]
    return np.asarray(found + rng.normal(size=found.size) * 0.003 * np.std(found))


def _between(ticks: Floats, motion: Motion, instants: Floats) -> Floats:
    """Positions between ticks, by their velocities."""
    k = np.clip(np.floor(instants / ticks[1] + 1e-9).astype(np.int64), 0, ticks.size - 2)
    u = instants / ticks[1] - k
    p, q = motion.position[k], motion.position[k + 1]
    v, w = motion.velocity[k] * ticks[1], motion.velocity[k + 1] * ticks[1]
    bent = (1.0 - 2.0 * u) * (q - p) + (u - 1.0) * v + u * w
    return np.asarray(p + u * (q - p) + u * (u - 1.0) * bent)


def _stamped(stamps: Floats, period_s: float, fault: str, rng: Rng) -> Floats:
    if fault == "rounded_stamps":
        grid = 1e-4 if period_s < 9e-4 else 1e-3 if period_s < 1.05e-2 else 1e-2
        return np.asarray(np.floor(stamps / grid) * grid)
    if fault == "few_digits":
        begun = 2.0 ** np.floor(np.log2(period_s * rng.uniform(0.1, 0.4) * 2.0**23))
        return np.asarray((begun + stamps).astype(np.float32).astype(np.float64))
    return stamps


def written(rows: Rows, drawn: Drawn, rng: Rng) -> dict[str, bytes]:
    """record.csv and map.yaml, in units that somebody likes."""
    resolution, factor = drawn.machine.resolution, drawn.machine.torque_constant if drawn.is_force else 1.0
    turn = {"count": 1.0, "rad": resolution, "deg": math.degrees(resolution)}
    length = {"count": 1.0, "m": resolution, "mm": 1e3 * resolution}
    units = length if drawn.is_linear else turn
    unit = str(rng.choice(list(units)))
    force = ("N", 1.0) if drawn.is_linear else ("N m", 1.0)
    name, (drive, scale) = (
        ("force", force) if drawn.is_force else ("current", (("A", 1.0), ("mA", 1e3))[rng.integers(2)])
    )
    time, per_second = (("s", 1.0), ("ms", 1e3))[rng.integers(2)]
    mapped: dict[str, Any] = {
        "device": "linear" if drawn.is_linear else "rotary",
        "time": {"column": f"t [{time}]", "unit": time},
        "position": {"column": f"q [{unit}]", "unit": unit},
        name: {"column": f"{name} [{drive}]", "unit": drive},
        "encoder": encoder(drawn),
    }
    if drawn.is_force:
        mapped["torque_constant"] = drawn.machine.torque_constant
    values = np.column_stack([rows.stamp * per_second, rows.position * units[unit], rows.current * factor * scale])
    digits = "%d" if unit == "count" else f"%.{max(0, math.ceil(-math.log10(units[unit])) + 2)}f"
    text = io.StringIO()
    names = [mapped[key]["column"] for key in ("time", "position", name)]
    np.savetxt(
        text, values, ["%.7f" if time == "s" else "%.4f", digits, "%.6g"], ",", header=",".join(names), comments=""
    )
    return {"record.csv": text.getvalue().encode(), "map.yaml": yaml.safe_dump(mapped, sort_keys=False).encode()}


def encoder(drawn: Drawn) -> dict[str, Any]:
    """The encoder as map and config have it."""
    if drawn.is_linear:
        return {"counts_per_metre": 1.0 / drawn.machine.resolution}
    return {"counts_per_rev": 2.0 * math.pi / drawn.machine.resolution}
