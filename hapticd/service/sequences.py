"""Sequences: a list of settings with one release each, as one experiment, which a stop, fault or cancellation ends.

The first step starts in the command's request, with the daemon's lock held; later steps start in the experiments' thread,
with the command's ordinal: what revokes the command revokes all of its steps. Each step is a run file with its config, like
any other release; ``sequence`` in its metadata names the sequence. At the end the previous settings are restored, with the
motor off.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from hapticd.config import LIVE_KEYS, apply_settings
from hapticd.record import RecordingError
from hapticd.record.metadata import utc_now
from hapticd.service.jobs import (
    RELEASE_DURATION_S,
    Experiment,
    refuse_deflection,
    release_result,
    wait_for_rest,
    wait_out,
)
from hapticd.service.refusals import DriverFailure, Refused
from hapticd.servo import faults, layout
from hapticd.servo.authority import Withdrawn

if TYPE_CHECKING:
    from pathlib import Path

    from hapticd.config import Config
    from hapticd.service.fault_manager import FaultManager
    from hapticd.service.rendering import Rendering
    from hapticd.service.rig import Rig
    from hapticd.servo.authority import Command

log = logging.getLogger(__name__)

_ANSWER_S: Final = 1.0


@dataclass(frozen=True)
class Step:
    """One release.

    Attributes:
        settings: dotted live keys, changed from the config before the sequence. config: with these settings.
        counts: the deflection in raw counts. duration_s: recorded time.
    """

    settings: Mapping[str, Any]
    config: Config
    counts: int
    duration_s: float

    @property
    def deflection(self) -> float:
        """The deflection in coarse ticks of its config."""
        return self.counts / self.config.encoder.decimation


class Running(Experiment):
    """A running or finished sequence.

    Args:
        name: of the sequence. steps: in order.
    """

    def __init__(self, name: str, steps: Sequence[Step]) -> None:
        super().__init__("sequence", sum(step.duration_s for step in steps))
        self.name, self.steps = name, steps
        self.began_utc = utc_now().isoformat(timespec="milliseconds")
        self.runs: list[dict[str, Any]] = []
        self.result = self.results()

    def results(self, **more: Any) -> dict[str, Any]:
        """The results so far."""
        return {"sequence": self.name, "steps": len(self.steps), "runs": list(self.runs), **more}

    def step_is_over(self) -> bool:
        """Whether the duration of the present step is over."""
        return self.elapsed_s() >= self.steps[len(self.runs)].duration_s

    def report(self) -> dict[str, Any]:
        """As for any experiment, with the present step."""
        done_s = sum(step.duration_s for step in self.steps[: len(self.runs)])
        at = (done_s + min(self.elapsed_s(), self.duration_s - done_s)) / self.duration_s
        progress = min(0.99, at) if self.state == "running" else 1.0
        return {
            **super().report(),
            "progress": progress,
            "step": min(len(self.runs) + 1, len(self.steps)),
            "steps": len(self.steps),
        }


def plan(rig: Rig, steps: Sequence[Mapping[str, Any]]) -> list[Step]:
    """The steps, based on the present settings.

    Raises:
        Refused: a step has a key that is not live, a rate that the driver does not support, or a deflection beyond the
            limit.
        ConfigError: a setting is invalid.
    """
    return [_planned(rig, step, f"step {number}") for number, step in enumerate(steps, 1)]


def _planned(rig: Rig, step: Mapping[str, Any], which: str) -> Step:
    settings = step.get("settings") or {}
    if fixed := sorted(key for key in settings if key not in LIVE_KEYS or key == "spring.origin"):
        why = "a release moves it" if fixed[0] == "spring.origin" else "cannot change while the daemon runs"
        raise Refused("restart_needed", f"{which}: {fixed[0]}: {why}")
    config = apply_settings(rig.config, settings, source=which)
    if config.servo.rate_hz != rig.config.servo.rate_hz and (reason := rig.driver.check_rate(config.servo.rate_hz)):
        raise Refused("driver", f"{which}: servo.rate_hz = {config.servo.rate_hz:g} Hz: {reason}")
    counts = round(step["deflection"] * config.encoder.decimation)
    refuse_deflection(config, counts, which)
    return Step(settings, config, counts, step.get("duration_s") or RELEASE_DURATION_S)


class Sequences:
    """Runs sequences.

    Args:
        rendering: the present rig, and what starts and ends its motion. fault_manager: no step starts while a fault is
            latched.
    """

    def __init__(self, rendering: Rendering, fault_manager: FaultManager) -> None:
        self._rendering, self._faults = rendering, fault_manager

    def admit(self, steps: Sequence[Step], force: bool) -> None:
        """Have the guard judge every step before the first one moves anything.

        Raises:
            Refused: with the number of the step.
        """
        for number, step in enumerate(steps, 1):
            try:
                self._rendering.admit(step.config, step.deflection, release=True, force=force)
            except Refused as refused:
                reason = f"step {number}: {refused.choice.get('reason', refused.message)}"
                remedies = [{**each, "step": number} for each in refused.choice.get("remedies") or ()]
                choice = {**refused.choice, "reason": reason, "remedies": remedies} if refused.choice else None
                raise Refused(refused.code, f"step {number}: {refused.message}", choice) from refused

    def begin(self, running: Running, command: Command, force: bool) -> Path:
        """Start the next step; returns its run file.

        Raises:
            Withdrawn: a stop or a cancellation. Refused: a fault, the guard, or a moving shaft.
            DriverFailure, RecordingError: it cannot be rendered, or recorded.
        """
        rig, number = self._rendering.rig, len(running.runs) + 1
        step = running.steps[number - 1]
        self._faults.refuse()
        rig.guard = self._rendering.admit(step.config, step.deflection, release=True, force=force)
        counts = wait_for_rest(rig, command)
        rig.change(command, step.config)
        rig.wait(rig.applied, _ANSWER_S)
        described = {
            "sequence": {
                "name": running.name,
                "began_utc": running.began_utc,
                "step": number,
                "steps": len(running.steps),
                "settings": dict(step.settings),
                "deflection": step.deflection,
            }
        }
        with rig.origin_at(counts - step.counts):
            rig.recorder.stop()
            path = rig.recorder.start(None, f"sequence-{number}", described)
            try:
                self._rendering.run(command, self._faults.refuse_new, exact=True)
            except BaseException:
                rig.recorder.stop()
                raise
        running.begin()
        return path

    def go_on(self, running: Running, rig: Rig, command: Command, path: Path, before: Config, force: bool) -> None:
        """Finish the started step, then run the others; in the experiments' thread."""
        further = command.further(lambda: not running.cancelled.is_set())
        more: dict[str, Any] = {}
        try:
            while True:
                step = running.steps[len(running.runs)]
                early, faulted = wait_out(running, command, rig, running.step_is_over)
                found = release_result(path, step.config.encoder.decimation, rig.origin_counts, rig.fault_number)
                running.runs.append(
                    {"run": str(path), "settings": dict(step.settings), "achieved_deflection": step.deflection, **found}
                )
                running.result = running.results()
                if faulted:
                    kind = faults.KINDS.get(rig.fault_number)
                    more["fault"] = kind.code if kind else None
                if early or faulted or len(running.runs) == len(running.steps):
                    break
                path = self.begin(running, further, force)
        except (Withdrawn, Refused, DriverFailure, RecordingError) as error:
            early, more["error"] = True, str(error)
        except Exception as error:
            log.exception("experiment %d failed", running.id)
            early, more["error"] = True, f"{type(error).__name__}: {error}"
        finally:
            restore(rig, before)
        running.result = running.results(**more)
        running.state = "done" if not early or more.get("fault") else "aborted"
        running.ended.set()


def restore(rig: Rig, before: Config) -> None:
    """Restore the previous settings, with the motor off. No motion starts, so this is never refused."""
    rig.switch_off()
    rig.wait(lambda: rig.state in (layout.OFF, layout.FAULT), _ANSWER_S)
    rig.ask(before)
