"""Experiments as jobs: ``release`` (Fig. 8) and ``excite``. One at a time, in a thread of its own, always recorded.

An experiment starts from rest and ends with the motor off. What it found is computed from its own recording, that is from
what the encoder saw, not from the model.
"""

from __future__ import annotations

import itertools
import logging
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.record import read_run
from hapticd.record.schema import FLAG_RUNNING
from hapticd.service.background import Background
from hapticd.service.refusals import Refused
from hapticd.servo import atomics, excitation, faults, layout
from hapticd.stability.numbers import from_config
from hapticd.stability.outcome import STRETCHES, decide
from hapticd.stability.storage import equivalent_deflection

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from hapticd.config import Config
    from hapticd.service.fault_manager import FaultManager
    from hapticd.service.rendering import Rendering
    from hapticd.service.rig import Rig
    from hapticd.servo.authority import Command


log = logging.getLogger(__name__)

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
        """The spring is rendered from now on."""
        self._began = time.monotonic()

    def elapsed_s(self) -> float:
        """Since :meth:`begin`."""
        return time.monotonic() - self._began

    def report(self) -> dict[str, Any]:
        """``id``, ``kind``, ``state``, ``progress`` and ``result``."""
        progress = min(0.99, self.elapsed_s() / self.duration_s) if self.state == "running" else 1.0
        return {"id": self.id, "kind": self.kind, "state": self.state, "progress": progress, "result": self.result}


IDLE = {"id": 0, "kind": None, "state": "idle", "progress": 0.0, "result": None}


class Experiments:
    """Begins experiments and knows the newest.

    Args:
        rendering: the rig in force, and what begins and ends its motion.
        faults: nothing begins while one is latched.

    Raises:
        RuntimeError: the system gives no thread.
    """

    def __init__(self, rendering: Rendering, faults: FaultManager) -> None:
        self._rendering, self._faults = rendering, faults
        self._newest: Experiment | None = None
        self._background = Background("hapticd-experiment")

    def report(self) -> dict[str, Any]:
        """The newest experiment."""
        return self._newest.report() if self._newest else dict(IDLE)

    def refuse_running(self) -> None:
        """Refuse while one is running.

        Raises:
            Refused: with its number.
        """
        newest = self._newest
        if newest and newest.state == "running":
            raise Refused("busy", f"experiment {newest.id} ({newest.kind}) is running; 'hapticd stop' ends it")

    def _admit(self, deflection: float, *, release: bool, force: bool) -> None:
        """Refuse a start at rest from a deflection in coarse ticks while anything rules it out."""
        self._faults.refuse()
        self.refuse_running()
        rig = self._rendering.rig
        rig.guard = self._rendering.admit(rig.config, deflection, release=release, force=force)

    def cancel(self) -> None:
        """End the one that is running, if any, and wait for it."""
        newest = self._newest
        if newest and newest.state == "running":
            newest.cancelled.set()
            newest.ended.wait(5.0)

    def alive(self) -> dict[str, bool]:
        """Name of its thread, and whether it still runs."""
        return {"hapticd-experiment": self._background.alive()}

    def is_running(self) -> bool:
        """Whether one is running, or its recording not closed yet."""
        newest = self._newest
        return newest is not None and newest.state == "running"

    def release(
        self, command: Command, deflection: float, duration_s: float | None, force: bool = False
    ) -> dict[str, Any]:
        """The Fig. 8 experiment: the origin is moved, never the shaft; from rest, at zero current."""
        rig = self._rendering.rig
        decimation = rig.config.encoder.decimation
        refuse_deflection(rig.config, round(deflection * decimation))
        self._admit(round(deflection * decimation) / decimation, release=True, force=force)
        self._rendering.switch_off()
        counts = wait_for_rest(rig, command)
        origin = counts - round(deflection * decimation)
        achieved = (counts - origin) / decimation
        experiment = Experiment("release", duration_s or RELEASE_DURATION_S)

        def finished() -> bool:
            return experiment.elapsed_s() >= experiment.duration_s

        def conclude(path: Path) -> dict[str, Any]:
            return {"achieved_deflection": achieved, **release_result(path, decimation, origin, rig.fault_number)}

        with rig.origin_at(origin):
            launched = self._launch(experiment, "release", command, finished, conclude, exact=True)
        return {"achieved_deflection": achieved, "soft_start_s": 0.0, **launched}

    def excite(self, command: Command, name: str, options: dict[str, Any], force: bool = False) -> dict[str, Any]:
        """Play an identification experiment about the shaft's present position."""
        rig = self._rendering.rig
        table = excitation.build(rig.config, name, **options)
        ticks = table.shape[1]
        if ticks > rig.core.excitation.shape[1]:
            longest = rig.core.excitation.shape[1] / rig.config.servo.rate_hz
            raise excitation.ExcitationError(f"{name} would last too long at this rate: at most {longest:.0f} s")
        self._admit(excited_deflection(rig.config, table), release=False, force=force)
        self._rendering.switch_off()
        counts = wait_for_rest(rig, command)
        experiment = Experiment(f"excite {name}", ticks / rig.config.servo.rate_hz)
        rig.core.excitation[:, :ticks] = table

        def finished() -> bool:
            return rig.core.load(atomics.EXCITATION_DONE) == experiment.id

        def conclude(path: Path) -> dict[str, Any]:
            return {"excitation": name, "ticks": ticks}

        played = {"excitation_id": experiment.id, "excitation_length": ticks}
        with rig.origin_at(counts):
            return self._launch(experiment, f"excite-{name}", command, finished, conclude, **played)

    def _launch(
        self,
        experiment: Experiment,
        label: str,
        command: Command,
        finished: Callable[[], bool],
        conclude: Callable[[Path], dict[str, Any]],
        **rendered: Any,
    ) -> dict[str, Any]:
        """Begin an experiment, in a recording of its own; one that is on is ended first."""
        rig = self._rendering.rig
        rig.recorder.stop()
        path = rig.recorder.start(None, label)
        try:
            self._rendering.run(command, self._faults.refuse_new, **rendered)
        except BaseException:
            rig.recorder.stop()
            raise
        experiment.begin()
        self._newest = experiment
        self._background.ask(lambda: run_job(experiment, command, rig, path, finished, conclude))
        return {"experiment": experiment.id, "duration_s": experiment.duration_s, "run": str(path), "guard": rig.guard}


def excited_deflection(config: Config, table: NDArray[np.float64]) -> float:
    """The release, in coarse ticks, that is equivalent to an excitation's motion; the guard judges this one.

    The place where the spring would hold the shaft moves with current and origin. A step of it is a release; a slow motion
    of it takes the shaft along at its own speed, whatever the way.

    Args:
        config: the configuration in force.
        table: shape (2, ticks): current in A, displacement of the origin in raw counts.
    """
    tick_force = config.spring.stiffness * config.resolution
    if tick_force == 0.0:
        return 0.0
    place = table[1] / config.encoder.decimation + table[0] * config.amplifier.torque_constant / tick_force
    fastest = float(np.max(np.abs(np.diff(place, prepend=0.0)), initial=0.0))
    way = float(np.max(np.abs(place), initial=0.0))
    return min(way, float(equivalent_deflection(fastest, from_config(config).mu)))


def refuse_deflection(config: Config, counts: int) -> None:
    """Refuse a release from farther than the shaft may go.

    Args:
        config: the configuration in force.
        counts: the deflection in raw counts.

    Raises:
        Refused: with the limit.
    """
    limit, unit = config.safety.max_excursion, "m" if config.is_linear else "rad"
    asked = abs(counts) * config.raw_resolution
    if limit and asked > limit:
        raise Refused(
            "excursion", f"a deflection of {asked:.4g} {unit} is beyond safety.max_excursion = {limit:g} {unit}"
        )


def wait_for_rest(rig: Rig, command: Command, timeout_s: float = REST_TIMEOUT_S) -> int:
    """Counts of a shaft that has not moved for 0.2 s.

    Raises:
        Refused: it keeps moving. Withdrawn: nobody wants to know any more.
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


def run_job(
    experiment: Experiment,
    command: Command,
    rig: Rig,
    path: Path,
    finished: Callable[[], bool],
    conclude: Callable[[Path], dict[str, Any]],
) -> None:
    """Wait for the end (or a fault, or a stop), switch off, close the recording, and work out the result."""
    try:
        while not (finished() or rig.state != layout.RUNNING or command.is_revoked()):
            if experiment.cancelled.wait(_POLL_S):
                break
        faulted = rig.state == layout.FAULT
        ended_early = not finished()
        rig.switch_off()
        rig.wait(lambda: rig.state in (layout.OFF, layout.FAULT), 1.0)
        rig.wait_ticks(2)
        rig.recorder.stop()
        result = {"run": str(path), **conclude(path)}
        if faulted:
            number = rig.fault_number
            result["fault"] = faults.KINDS[number].code if number in faults.KINDS else None
        experiment.result = result
        experiment.state = "aborted" if ended_early and not faulted else "done"
    except Exception as error:
        log.exception("experiment %d failed", experiment.id)
        experiment.result = {"run": str(path), "error": f"{type(error).__name__}: {error}"}
        experiment.state = "aborted"
    finally:
        experiment.ended.set()


def release_result(path: Path, decimation: int, origin_counts: int, fault_number: int) -> dict[str, Any]:
    """What a release did, from its recording.

    Returns:
        ``outcome`` (``decaying``: it came or comes to rest; ``persistent``; ``growing``; None: a trip of the limits came
        before it could be told), ``held_by_friction`` (it never moved by a raw count), ``final`` position in coarse ticks
        (true to one raw count), ``rest`` (after how many periods and s, None while moving) and ``oscillation`` of the last
        quarter (peak to peak in ticks and raw counts, frequency in Hz).
    """
    run = read_run(path)
    running = (run.columns["flags"] & FLAG_RUNNING) != 0
    counts = run.columns["encoder_counts"][running]
    tick = run.columns["tick"][running]
    time_s = run.columns["time_s"][running]
    if len(counts) < 4:
        return {"outcome": None, "held_by_friction": None, "final": None, "rest": None, "oscillation": None}
    xi = (counts - origin_counts + 0.5) / decimation
    moving = np.flatnonzero(np.diff(counts) != 0)
    last_move = int(moving[-1]) + 1 if len(moving) else 0
    at_rest = time_s[-1] - time_s[last_move] >= max(REST_S, 0.1 * (time_s[-1] - time_s[0]))
    tail = counts[-(len(counts) // 4) :]
    outcome: str | None
    if fault_number in _RUNAWAY:
        # It began at rest: farther out than that, by more than a reading's error, it has gained energy.
        away = np.abs(counts - origin_counts)
        outcome = "growing" if away.max() > away[0] + 1 else None
    else:
        # The rules of `simulate`, on the squared swing of each stretch in place of its energy. What the encoder shows
        # cannot tell a monotone fall of energy from one with rises.
        stretches = np.array_split(counts[len(counts) // 2 :], STRETCHES)
        outcome = decide(True, np.array([_swing(part) ** 2 for part in stretches]), at_rest, False)
    rest = None
    if at_rest:
        rest = {"after_periods": int(tick[last_move] - tick[0]), "after_s": float(time_s[last_move] - time_s[0])}
    return {
        "outcome": outcome,
        "held_by_friction": len(moving) == 0,
        "final": {"position_ticks": float(xi[-1])},
        "rest": rest,
        "oscillation": None if at_rest else _oscillation(tail, time_s[-len(tail) :], _swing(tail), decimation),
    }


def _swing(counts: NDArray[np.int64]) -> float:
    """Typical peak to peak: the median over eight stretches, so that one late tick does not make a verdict."""
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
