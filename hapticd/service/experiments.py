"""Experiments as jobs: ``release`` (Fig. 8), ``excite`` and sequences of releases.

One at a time, in its own thread, always recorded. An experiment starts from rest and ends with the motor off. Its result is
computed from its recording, that is from the encoder and not from the model.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.service import sequences
from hapticd.service.background import Background
from hapticd.service.jobs import (
    RELEASE_DURATION_S,
    Experiment,
    refuse_deflection,
    release_result,
    wait_for_rest,
    wait_out,
)
from hapticd.service.refusals import Refused
from hapticd.servo import atomics, excitation, faults
from hapticd.stability.numbers import from_config
from hapticd.stability.storage import equivalent_deflection

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from hapticd.config import Config
    from hapticd.service.fault_manager import FaultManager
    from hapticd.service.rendering import Rendering
    from hapticd.service.rig import Rig
    from hapticd.servo.authority import Command


log = logging.getLogger(__name__)

IDLE = {"id": 0, "kind": None, "state": "idle", "progress": 0.0, "result": None}


class Experiments:
    """Starts experiments, and keeps the report of the newest.

    Args:
        rendering: the present rig, and what starts and ends its motion.
        faults: no experiment starts while a fault is latched.

    Raises:
        RuntimeError: a thread cannot be created.
    """

    def __init__(self, rendering: Rendering, faults: FaultManager) -> None:
        self._rendering, self._faults = rendering, faults
        self._sequences = sequences.Sequences(rendering, faults)
        self._newest: Experiment | None = None
        self._background = Background("hapticd-experiment")

    def report(self) -> dict[str, Any]:
        """Report of the newest experiment."""
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
        """Refuse a start at rest from a deflection in coarse ticks, if there is any reason against it."""
        self._faults.refuse()
        self.refuse_running()
        rig = self._rendering.rig
        rig.guard = self._rendering.admit(rig.config, deflection, release=release, force=force)

    def cancel(self) -> None:
        """End the running experiment, if any, and wait for it."""
        newest = self._newest
        if newest and newest.state == "running":
            newest.cancelled.set()
            newest.ended.wait(5.0)

    def alive(self) -> dict[str, bool]:
        """Name of its thread to whether it runs."""
        return {"hapticd-experiment": self._background.alive()}

    def is_running(self) -> bool:
        """Whether an experiment is running, or its recording is not closed yet."""
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

    def sequence(self, command: Command, steps: Sequence[Mapping[str, Any]], name: str, force: bool) -> dict[str, Any]:
        """Releases one after another, each with its settings; a stop or fault ends all of them."""
        rig = self._rendering.rig
        self._faults.refuse()
        self.refuse_running()
        running = sequences.Running(name, sequences.plan(rig, steps))
        self._sequences.admit(running.steps, force)
        self._rendering.switch_off()
        before = rig.config
        try:
            path = self._sequences.begin(running, command, force)
        except BaseException:
            sequences.restore(rig, before)
            raise
        self._newest = running
        self._background.ask(lambda: self._sequences.go_on(running, rig, command, path, before, force))
        job = {"experiment": running.id, "duration_s": running.duration_s, "run": str(path), "guard": rig.guard}
        return {**job, "sequence": name, "steps": len(running.steps)}

    def refuse_sequence(self) -> None:
        """Refuse a change of settings while a sequence runs: it has its own.

        Raises:
            Refused: with its number.
        """
        if isinstance(self._newest, sequences.Running):
            self.refuse_running()

    def _launch(
        self,
        experiment: Experiment,
        label: str,
        command: Command,
        finished: Callable[[], bool],
        conclude: Callable[[Path], dict[str, Any]],
        **rendered: Any,
    ) -> dict[str, Any]:
        """Start an experiment in its own recording; a running recording is ended first."""
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
    """The release, in coarse ticks, that is equivalent to an excitation's motion; the guard judges this release.

    The equilibrium position of the spring moves with current and origin. A step of it is equivalent to a release; in a slow
    motion of it the shaft follows with the same speed, whatever the distance.

    Args:
        config: the present configuration.
        table: shape (2, ticks): current in A, displacement of the origin in raw counts.
    """
    tick_force = config.spring.stiffness * config.resolution
    if tick_force == 0.0:
        return 0.0
    place = table[1] / config.encoder.decimation + table[0] * config.amplifier.torque_constant / tick_force
    fastest = float(np.max(np.abs(np.diff(place, prepend=0.0)), initial=0.0))
    way = float(np.max(np.abs(place), initial=0.0))
    return min(way, float(equivalent_deflection(fastest, from_config(config).mu)))


def run_job(
    experiment: Experiment,
    command: Command,
    rig: Rig,
    path: Path,
    finished: Callable[[], bool],
    conclude: Callable[[Path], dict[str, Any]],
) -> None:
    """Wait for the end (or a fault, or a stop), switch off, close the recording, and compute the result."""
    try:
        ended_early, faulted = wait_out(experiment, command, rig, finished)
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
