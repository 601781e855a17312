"""Parts of every experiment: its report, waiting for rest and for its end, and the result of a release."""

from __future__ import annotations

import itertools
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.record import read_run
from hapticd.record.schema import FLAG_RUNNING
from hapticd.service.refusals import Refused
from hapticd.servo import faults, layout
from hapticd.stability.outcome import STRETCHES, Outcome, decide

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from hapticd.config import Config
    from hapticd.service.rig import Rig
    from hapticd.servo.authority import Command

REST_S = 0.2
REST_TIMEOUT_S = 5.0
RELEASE_DURATION_S = 3.0
_POLL_S = 0.02
_RUNAWAY = (faults.OVER_SPEED, faults.EXCURSION, faults.OVER_CURRENT, faults.ENCODER_JUMP)


class Experiment:
    """One running or finished experiment."""

    _numbers = itertools.count(1)

    def __init__(self, kind: str, duration_s: float) -> None:
        self.id = next(self._numbers)
        self.kind = kind
        self.duration_s = duration_s
        self.state = "running"
        self.result: dict[str, Any] | None = None
        self.cancelled = threading.Event()
        self.ended = threading.Event()
        self._began = time.monotonic()

    def begin(self) -> None:
        """The spring is rendered now: start the clock."""
        self._began = time.monotonic()

    def elapsed_s(self) -> float:
        """Since :meth:`begin`."""
        return time.monotonic() - self._began

    def report(self) -> dict[str, Any]:
        """``id``, ``kind``, ``state``, ``progress`` and ``result``."""
        progress = min(0.99, self.elapsed_s() / self.duration_s) if self.state == "running" else 1.0
        return {"id": self.id, "kind": self.kind, "state": self.state, "progress": progress, "result": self.result}


def refuse_deflection(config: Config, counts: int, which: str = "") -> None:
    """Refuse a release from beyond the shaft's limit.

    Args:
        config: the present configuration.
        counts: the deflection in raw counts.
        which: name of the step in a sequence, for the message.

    Raises:
        Refused: with the limit.
    """
    limit, unit = config.safety.max_excursion, "m" if config.is_linear else "rad"
    asked = abs(counts) * config.raw_resolution
    if limit and asked > limit:
        raise Refused(
            "excursion",
            f"{which and which + ': '}a deflection of {asked:.4g} {unit} is beyond safety.max_excursion = {limit:g} {unit}",
        )


def wait_for_rest(rig: Rig, command: Command, timeout_s: float = REST_TIMEOUT_S) -> int:
    """Counts of a shaft that has not moved for 0.2 s.

    Raises:
        Refused: it keeps moving. Withdrawn: the command was cancelled.
    """
    deadline = time.monotonic() + timeout_s
    last, since = rig.counts, time.monotonic()
    while time.monotonic() < deadline:
        time.sleep(_POLL_S)
        command.refuse()
        counts = rig.counts
        if counts != last:
            last, since = counts, time.monotonic()
        elif time.monotonic() - since >= REST_S:
            return counts
    raise Refused("moving", f"the shaft has not come to rest within {timeout_s:g} s; hold it still and try again")


def wait_out(experiment: Experiment, command: Command, rig: Rig, finished: Callable[[], bool]) -> tuple[bool, bool]:
    """Wait for the end (or a fault, or a stop), switch off, and close the recording.

    Returns:
        Whether it ended early, and whether by a fault.
    """
    while not (finished() or rig.state != layout.RUNNING or command.is_revoked()):
        if experiment.cancelled.wait(_POLL_S):
            break
    faulted = rig.state == layout.FAULT
    ended_early = not finished()
    rig.switch_off()
    rig.wait(lambda: rig.state in (layout.OFF, layout.FAULT), 1.0)
    rig.wait_ticks(2)
    rig.recorder.stop()
    return ended_early, faulted


def release_result(path: Path, decimation: int, origin_counts: int, fault_number: int) -> dict[str, Any]:
    """Result of a release, from its recording.

    Returns:
        ``outcome`` (``decaying``: it came or comes to rest; ``persistent``; ``growing``; None: a limit tripped before it
        could be determined), ``held_by_friction`` (it never moved by a raw count), ``final`` position in coarse ticks
        (accurate to one raw count), ``rest`` (after how many periods and s, None while moving) and ``oscillation`` of the
        last quarter (peak to peak in ticks and raw counts, frequency in Hz).
    """
    run = read_run(path)
    running = (run.columns["flags"] & FLAG_RUNNING) != 0
    counts = run.columns["encoder_counts"][running]
    tick = run.columns["tick"][running]
    time_s = run.columns["time_s"][running]
    if len(counts) < 4:
        return {"outcome": None, "held_by_friction": None, "final": None, "rest": None, "oscillation": None}
    xi = (counts - origin_counts + 0.5) / decimation
    shown, last_move, at_rest = shown_outcome(counts, time_s)
    tail = counts[-(len(counts) // 4) :]
    outcome: str | None = shown
    if fault_number in _RUNAWAY:
        # It started at rest: at a larger distance, beyond the quantisation, it has gained energy.
        away = np.abs(counts - origin_counts)
        outcome = "growing" if away.max() > away[0] + 1 else None
    rest = None
    if at_rest:
        rest = {"after_periods": int(tick[last_move] - tick[0]), "after_s": float(time_s[last_move] - time_s[0])}
    return {
        "outcome": outcome,
        "held_by_friction": last_move == 0,
        "final": {"position_ticks": float(xi[-1])},
        "rest": rest,
        "oscillation": None if at_rest else _oscillation(tail, time_s[-len(tail) :], _swing(tail), decimation),
    }


def shown_outcome(counts: NDArray[Any], time_s: NDArray[np.float64]) -> tuple[Outcome, int, bool]:
    """Outcome of a release without a trip, from the encoder; also the row of the last move, and whether it is at rest.

    The rules of `simulate`, with the squared amplitude of each stretch instead of its energy. From the encoder, a monotone
    fall of energy cannot be distinguished from one with rises.

    Args:
        counts: (n,) of any unit, 4 at least. time_s: (n,) s.
    """
    moving = np.flatnonzero(np.diff(counts) != 0)
    last_move = int(moving[-1]) + 1 if len(moving) else 0
    at_rest = bool(time_s[-1] - time_s[last_move] >= max(REST_S, 0.1 * (time_s[-1] - time_s[0])))
    stretches = np.array_split(counts[len(counts) // 2 :], STRETCHES)
    return decide(True, np.array([_swing(part) ** 2 for part in stretches]), at_rest, False), last_move, at_rest


def _swing(counts: NDArray[Any]) -> float:
    """Typical peak-to-peak amplitude: the median over eight stretches, so that one late tick does not decide the outcome."""
    return float(np.median([np.ptp(part) for part in np.array_split(counts, 8) if len(part)]))


def _oscillation(
    counts: NDArray[np.int64], time_s: NDArray[np.float64], swing: float, decimation: int
) -> dict[str, float | None]:
    centred = counts - counts.mean()
    crossings = np.flatnonzero((centred[:-1] < 0) & (centred[1:] >= 0))
    frequency = None
    if len(crossings) > 1:
        frequency = float((len(crossings) - 1) / (time_s[crossings[-1]] - time_s[crossings[0]]))
    return {"peak_to_peak_ticks": swing / decimation, "peak_to_peak_counts": swing, "frequency_hz": frequency}
