"""What a recording can and cannot tell, from its samples alone, before anything is searched in it.

Nothing here needs a model: stamps, quantisation, saturation, excitation by speed, direction and frequency, rests, and
whether the command is a law of the position (a closed loop), in which case it brings no excitation of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.record.errors import RunFileError
from hapticd.record.run import Run, clock_steps
from hapticd.record.stamp_grid import spread

FloatArray = NDArray[np.float64]

_LOST: Final = 1.5
"""Periods between two stamps, beyond which rows are missing."""
_FEW_CELLS: Final = 10.0
_SATURATED: Final = 0.01
"""Share of the samples at the largest command."""
_LAW: Final = 0.98
"""Share of the command that position and velocity explain, beyond which it is a law of them."""
_BOTH_WAYS: Final = 0.02
_SPEEDS: Final = 8.0
"""Fastest over slowest speed (90 % and 10 % of what moves) that tell frictions that depend on it."""
_LONG_S, _WARM_S = 5.0, 120.0
_DELAY: Final = 50.0
"""Sampling rate over the fastest frequency of the command, below which a delay of a period shows."""
_SMOOTH_S: Final = 0.01
_SWEPT: Final = frozenset(
    {
        "Coulomb friction",
        "viscous friction",
        "bias beside asymmetric friction",
        "friction that falls with speed",
        "ripple in angle",
    }
)


@dataclass(frozen=True)
class Inspection:
    """What was found in one recording.

    Attributes:
        name: of the file. stamps, position, current, excitation: figures by name, SI units.
        can_tell, cannot_tell: what the recording is good for, and for what not and why, in words.
        next_experiment: command of the experiment that would tell most of the rest; None where nothing is missing.
    """

    name: str
    stamps: dict[str, Any]
    position: dict[str, Any]
    current: dict[str, Any]
    excitation: dict[str, Any]
    can_tell: tuple[str, ...]
    cannot_tell: tuple[str, ...]
    next_experiment: str | None

    @property
    def document(self) -> dict[str, Any]:
        """The keys of ``hapticd inspect --json``."""
        return {key: value for key, value in vars(self).items() if key != "name"} | {"run": self.name}

    @property
    def line(self) -> str:
        """One line: what there is, and what is missing."""
        lacks = "; ".join(self.cannot_tell) or "nothing is missing"
        return (
            f"{self.name}: {self.stamps['duration_s']:.4g} s at {self.stamps['rate_hz']:.5g} Hz, "
            f"{self.position['span_cells']:.4g} cells of travel; cannot tell: {lacks}"
        )


def inspect(run: Run) -> Inspection:
    """Look at a run that has been read; some milliseconds.

    Raises:
        RunFileError: it has fewer than 20 rows, or a clock that does not rise: nothing can be said of it.
    """
    time_s = np.asarray(run.columns["time_s"], float)
    steps = np.diff(time_s)
    if time_s.size < 20 or not np.all(steps > 0.0):
        raise RunFileError(
            f"{run.path}: {time_s.size} rows, or a clock that does not rise: nothing can be told from it"
        )
    position, cell = _position(run)
    driven = np.asarray(run.columns.get("current_command_A", run.columns.get("force")), float)
    stamps = _stamps(run, time_s, steps, position / cell)
    velocity = _velocity(position, stamps["period_s"])
    where = {
        "cell": cell,
        "span": float(np.ptp(position)),
        "span_cells": float(np.ptp(position) / cell),
        "still_share": float(np.mean(np.diff(position) == 0.0)),
    }
    current = _command(driven)
    excitation = _excitation(position, velocity, driven, stamps["period_s"], cell)
    found = list(_judged(run, stamps, where, current, excitation))
    can = tuple(name for name, why in found if not why)
    return Inspection(
        run.path.name,
        stamps,
        where,
        current,
        excitation,
        can,
        tuple(f"{name} ({why})" for name, why in found if why),
        _next({name for name, why in found if why}),
    )


def _position(run: Run) -> tuple[FloatArray, float]:
    """Position and the width of its cell: counts, or the smallest step there is."""
    if "encoder_counts" in run.columns:
        return np.asarray(run.columns["encoder_counts"], float), 1.0
    position = np.asarray(run.columns["position"], float)
    moves = np.abs(np.diff(position))
    moves = moves[moves > 0.0]
    return position, float(np.quantile(moves, 0.01)) if moves.size else 1.0


def _stamps(run: Run, time_s: FloatArray, steps: FloatArray, cells: FloatArray) -> dict[str, Any]:
    grid = spread(time_s)[1] or None
    period = float(np.median(steps)) if grid is None else float(np.mean(steps))
    late = run.columns.get("wake_late_ns")
    set_ = clock_steps(time_s, cells)
    lost = np.sum(np.rint(steps[steps > _LOST * period + (grid or 0.0)] / period - 1.0))
    return {
        "rows": int(time_s.size),
        "duration_s": float(time_s[-1] - time_s[0]),
        "period_s": period,
        "rate_hz": (time_s.size - 1) / float(time_s[-1] - time_s[0]),
        "jitter_s": float(np.std(np.minimum(steps, 2.0 * period) - period)),
        "grid_s": grid,
        "lost_rows": int(lost) - sum(round(step / period) for _, step in set_),
        "clock_steps": [{"row": row, "step_s": step} for row, step in set_],
        "late_max_s": None if late is None else 1e-9 * float(np.max(late)),
    }


def _velocity(position: FloatArray, period: float) -> FloatArray:
    """Slope over a hundredth of a second, or three samples, (n,)."""
    half = max(1, round(0.5 * _SMOOTH_S / period))
    padded = np.pad(position, half, mode="edge")
    return np.asarray((padded[2 * half :] - padded[: -2 * half]) / (2.0 * half * period))


def _command(driven: FloatArray) -> dict[str, Any]:
    finite = driven[np.isfinite(driven)]
    values = np.unique(finite)
    largest = float(np.abs(finite).max()) if finite.size else 0.0
    at = float(np.mean(np.abs(finite) >= largest * (1.0 - 1e-9))) if largest else 0.0
    return {
        "largest": largest,
        "values": int(values.size),
        "step": float(np.diff(values).min()) if values.size > 1 else 0.0,
        "at_largest_share": at,
        "saturated": bool(values.size > 20 and at > _SATURATED),
    }


def _excitation(
    position: FloatArray, velocity: FloatArray, driven: FloatArray, period: float, cell: float
) -> dict[str, Any]:
    moves = np.abs(velocity) > cell / _SMOOTH_S
    speeds = np.abs(velocity[moves])
    slow, fast = (float(value) for value in np.quantile(speeds, (0.1, 0.9))) if speeds.size else (0.0, 0.0)
    forward = float(np.mean(velocity[moves] > 0.0)) if speeds.size else 0.0
    going = np.sign(velocity[moves])
    drive = np.nan_to_num(driven)
    power = np.abs(np.fft.rfft((drive - drive.mean()) * np.hanning(drive.size))) ** 2
    total = np.cumsum(power)
    frequencies = np.fft.rfftfreq(drive.size, period)
    band = [float(frequencies[int(np.searchsorted(total, share * total[-1]))]) for share in (0.05, 0.95)]
    return {
        "moving_share": float(np.mean(moves)),
        "speed_slow": slow,
        "speed_fast": fast,
        "forward_share": forward,
        "reversals": int(np.count_nonzero(np.diff(going) != 0.0)),
        "command_band_hz": band if total[-1] > 0.0 else None,
        "command_explained_by_motion": _law_of(position, velocity, drive),
    }


def _law_of(position: FloatArray, velocity: FloatArray, drive: FloatArray) -> float:
    """Share of the command's variance that is linear in position and velocity."""
    if np.ptp(drive) == 0.0 or np.ptp(position) == 0.0:
        return 0.0
    terms = np.stack([np.ones_like(position), position, velocity], 1)
    terms /= np.abs(terms).max(axis=0, initial=1e-300)
    left = drive - terms @ np.linalg.lstsq(terms, drive, rcond=None)[0]
    return float(1.0 - np.var(left) / np.var(drive))


def _judged(
    run: Run, stamps: dict[str, Any], where: dict[str, Any], current: dict[str, Any], excitation: dict[str, Any]
) -> Iterator[tuple[str, str]]:
    """What might be told, and why it cannot be; nothing where it can."""
    still = where["span_cells"] < _FEW_CELLS
    motion = f"it moves {where['span_cells']:.3g} cells in all" if still else ""
    spread = excitation["speed_fast"] / excitation["speed_slow"] if excitation["speed_slow"] else 0.0
    both = _BOTH_WAYS < excitation["forward_share"] < 1.0 - _BOTH_WAYS
    one_way = "" if both else "it moves one way only"
    constant = "the command never changes" if current["values"] < 2 else ""
    closed = excitation["command_explained_by_motion"]
    law = f"{100 * closed:.1f} % of the command is a law of the position: a closed loop" if closed > _LAW else ""
    band, rate = excitation["command_band_hz"], stamps["rate_hz"]
    slow = (
        ""
        if band and rate / max(band[1], 1e-9) < _DELAY
        else f"the command has nothing above {band[1] if band else 0:.3g} Hz"
    )
    steady = f"its speeds differ by {spread:.2g} times" if spread < _SPEEDS else ""
    yield "inertia", motion or constant
    yield "Coulomb friction", motion or one_way
    yield "viscous friction", motion or steady
    yield "bias beside asymmetric friction", motion or one_way
    yield (
        "friction that falls with speed",
        motion or steady or ("" if excitation["reversals"] > 3 else "it reverses too seldom"),
    )
    yield "stiction and presliding", motion or ("" if 0.02 < where["still_share"] < 0.98 else "it hardly rests")
    config = run.metadata.get("config") or run.metadata.get("model") or {}
    per_rev = config.get("encoder", {}).get("counts_per_rev") if "encoder_counts" in run.columns else None
    if per_rev:
        turns = where["span"] / per_rev
        yield "ripple in angle", "" if turns >= 1.0 else f"it covers {turns:.2g} of a turn"
    yield "delay and lag", constant or slow or law
    yield "current limit", "" if current["saturated"] else "no limit is reached"
    yield "warming up", "" if stamps["duration_s"] > _WARM_S else f"{stamps['duration_s']:.3g} s are too short"
    if stamps["duration_s"] < _LONG_S:
        yield "small effects", f"{stamps['duration_s']:.3g} s are too short to tell them from chance"
    if stamps["grid_s"]:
        yield "times within a period", f"its stamps lie on a grid of {1e3 * stamps['grid_s']:g} ms"
    if stamps["lost_rows"]:
        yield "what happened in lost rows", f"{stamps['lost_rows']} are missing"


def _next(lacks: set[str]) -> str | None:
    for needs, command in (
        ({"inertia", "delay and lag"}, "hapticd excite chirp"),
        (_SWEPT, "hapticd excite sweep"),
        ({"stiction and presliding"}, "hapticd excite ramp"),
        ({"small effects"}, "hapticd excite chirp --duration 20"),
        ({"current limit"}, "hapticd excite steps"),
    ):  # fmt: skip
        if lacks & needs:
            return command
    return None
