"""Which steps run, what keeps the others from it, and the state on disk with which a later call goes on."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Collection
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from drivers import DriverError
from hapticd.client import DaemonUnreachable, RequestRefused
from hapticd.commission.step import DisturbedError, Line, Picture, Result, StepError, skipped
from hapticd.commission.steps import STEPS
from hapticd.config import config_digest
from hapticd.figures.files import write_text
from hapticd.hil.errors import HilError
from hapticd.record.errors import RunFileError

if TYPE_CHECKING:
    from hapticd.commission.rig import Rig
    from hapticd.commission.steps import Step
    from hapticd.config import Config

STATE: Final = "state.json"
ATTEMPTS: Final = 3
LATE_S: Final = 0.01
"""A machine whose ordinary threads wait longer is what loses exchanges."""
_REMEDY: Final = (
    "end what else runs on this machine (hapticd doctor; tune it for real time), then the same command again"
)
_ENDS: Final = (StepError, DriverError, DaemonUnreachable, RequestRefused, HilError, RunFileError, ValueError)
"""How a step may end without an answer; the text says why."""


class State:
    """Results on disk, of one config; those of another are of another rig.

    Args:
        folder: holds it. config: of the rig.
    """

    def __init__(self, folder: Path, config: Config) -> None:
        self._path, self.digest = folder / STATE, config_digest(config)
        self.results: dict[str, Result] = {}
        self.seconds = 0.0
        self.forgotten = False
        """Whether there were results of another config."""
        if self._path.exists():
            stored = json.loads(self._path.read_text())
            self.forgotten = stored["config_digest"] != self.digest
            if not self.forgotten:
                self.results = {name: _result(each) for name, each in stored["results"].items()}
                self.seconds = float(stored["rig_s"])

    def save(self, results: dict[str, Result], seconds: float) -> None:
        """Write it whole, or not at all."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        found = {name: asdict(result) for name, result in results.items()}
        document = {"config_digest": self.digest, "rig_s": seconds, "results": found}
        write_text(self._path, json.dumps(document, default=lambda value: value.tolist()))


def _result(stored: dict[str, Any]) -> Result:
    picture = stored["picture"]
    if picture is not None:
        picture = Picture(**{**picture, "lines": tuple(Line(**each) for each in picture["lines"])})
    return Result(**{**stored, "picture": picture})


def commission(
    rig: Rig,
    *,
    again: Collection[str] = (),
    only: Collection[str] = (),
    told: Callable[[Step, Result], None] = lambda step, result: None,
) -> dict[str, Result]:
    """Do what has not passed yet, in order; results are on disk after every step.

    Args:
        rig: its folder holds the state.
        again: steps that run though they have passed. only: leave out all others, as they were.
        told: called with every step that ran or was kept.

    Returns:
        Name to result, in the order of the steps.

    Raises:
        KeyboardInterrupt: at zero current, and with the state saved.
    """
    state = State(rig.folder, rig.config)
    if state.forgotten:
        rig.say("the config is another one than that of the results here: all steps begin anew")
    rig.results, rig.seconds = state.results, state.seconds
    ran: set[str] = set()
    for number, step in enumerate(STEPS, 1):
        had = rig.results.get(step.name)
        if only and step.name not in only:
            continue
        renewed = step.name in (*again, *only) or bool(ran.intersection(step.needs))
        if had is not None and had.result == "pass" and not renewed:
            told(step, had)
            continue
        ran.add(step.name)
        rig.say(f"{number}/{len(STEPS)} {step.title}: {step.will}")
        try:
            rig.results[step.name] = _one(rig, step)
        finally:
            state.save(rig.results, rig.seconds)
        told(step, rig.results[step.name])
    rig.results = {step.name: rig.results[step.name] for step in STEPS if step.name in rig.results}
    return rig.results


def _one(rig: Rig, step: Step) -> Result:
    ended = [name for name, result in rig.results.items() if result.dangerous and name != step.name]
    if step.moves and ended:
        return skipped(f"nothing moves after what {ended[0]} found")
    for name in step.needs:
        found = rig.results.get(name)
        if found is None or found.result != "pass":
            said = "was not done" if found is None else "failed" if found.result == "fail" else "was skipped"
            return skipped(f"it needs {name}, which {said}")
    if step.moves and not rig.operator.agrees(f"{step.title}: go on?"):
        return skipped("you said no")
    for _ in range(ATTEMPTS):
        begun_ns, missed = time.monotonic_ns(), rig.missed
        result, disturbance = _tried(rig, step)
        if not disturbance and result.result == "fail" and not result.dangerous and rig.missed > missed:
            late_s = rig.late_s(begun_ns)
            if late_s > LATE_S:
                disturbance = (
                    f"{result.finding}; {rig.missed - missed} exchanges failed or periods were missed, and programs "
                    f"waited for {1e3 * late_s:.0f} ms"
                )
        if not disturbance:
            return result
    return replace(
        result, result="disturbed", finding=f"this machine is too busy, {ATTEMPTS} times: {disturbance}", remedy=_REMEDY
    )


def _tried(rig: Rig, step: Step) -> tuple[Result, str]:
    """What a step finds, and what disturbed it, if it says so itself."""
    try:
        result = step.run(rig)
        return result, result.finding if result.result == "disturbed" else ""
    except _ENDS as error:
        disturbed = isinstance(error, DisturbedError) or getattr(error, "code", "") == "expired"
        rig.release()
        found = Result("fail", str(error), cause="the step could not be finished", remedy="hapticd help FAULT; the log")
        return found, found.finding if disturbed else ""
