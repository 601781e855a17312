"""The present rig, and what starts and ends its motion: the authority, the guard, the recording of a run.

Each daemon has one, shared by its commands, its experiments and its fault manager.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from typing import TYPE_CHECKING, Any

from hapticd.control.refusal_text import refusal_text
from hapticd.record import RecordingError
from hapticd.service.prediction import motion_of, predict, weigh
from hapticd.service.refusals import DriverFailure, Refused
from hapticd.servo import layout
from hapticd.stability.guard import Judgement, judge

if TYPE_CHECKING:
    from collections.abc import Callable

    from hapticd.config import Config
    from hapticd.control.endpoints import JsonDict
    from hapticd.service.rig import Rig
    from hapticd.servo.authority import Authority, Command

log = logging.getLogger(__name__)

ANSWER_S = 1.0
"""The loop answers within a tick; after this time it does not answer [s]."""


class Rendering:
    """Starts and ends motion on the present rig.

    Attributes:
        rig: the present rig; a reload replaces it.
        authority: decides which command may move it.
        judged: the last config and motion (a deflection in coarse ticks) after the guard, and whether the guard admitted
            them; otherwise they were forced, or it only warned. None before the first.
    """

    def __init__(self, rig: Rig, authority: Authority) -> None:
        self.rig, self.authority = rig, authority
        self.judged: tuple[Config, float | None, bool] | None = None
        self._recorded: Command | None = None
        self._recording = threading.Lock()

    def admit(
        self,
        config: Config,
        deflection: float | None,
        *,
        origin_counts: int | None = None,
        release: bool = False,
        force: bool = False,
    ) -> JsonDict:
        """The guard's judgement, as data, of a config and a motion from rest at a deflection in coarse ticks.

        Args:
            config: to be applied. deflection: None if no motion starts.
            origin_counts: of the new spring, for a prediction of the motion; None for no prediction.
            release: whether a smaller deflection is a possible remedy. force: override a refusal.

        Raises:
            Refused: the motion would not die out, or would exceed a limit.
        """
        judgement = judge(config, self.rig.driver.latency_s, deflection=deflection, release=release, force=force)
        if origin_counts is not None and judgement.verdict != "off":
            judgement = weigh(judgement, predict(config, origin_counts, motion_of(self.rig)), config, force)
        document = enforce(judgement)
        self.judged = config, deflection, judgement.verdict == "admitted"
        return document

    def switch_off(self) -> None:
        """Switch the amplifier off, and end the recording of a run."""
        self.rig.switch_off()
        self.rig.wait(lambda: self.rig.state == layout.OFF, ANSWER_S)
        self.end_recording()

    def run(self, command: Command, refuse_fault: Callable[[], None], **rendered: Any) -> None:
        """Start a command's motion, and wait until the loop renders or reports why it does not.

        Args:
            command: the command.
            refuse_fault: raises `Refused` for a latched fault.
            rendered: what is rendered in addition to the spring (`Rig.run`).

        Raises:
            Withdrawn: the command was revoked. Refused: a fault.
            DriverFailure: the loop does not start to render.
        """
        rig = self.rig
        timeout = (rig.config.safety.enable_timeout_s or 60.0) + ANSWER_S
        rig.run(command, **rendered)
        rig.wait(lambda: rig.state in (layout.RUNNING, layout.FAULT) or command.is_revoked(), timeout)
        if rig.state == layout.FAULT:
            refuse_fault()
        if command.is_revoked():
            command.refuse()
        if rig.state != layout.RUNNING:
            rig.switch_off()
            raise DriverFailure(f"the servo loop did not start to render within {timeout:g} s")

    def refuse_place(self) -> None:
        """Refuse to render if the origin's position is unknown, or more than ``safety.max_excursion`` from the shaft."""
        rig = self.rig
        limit, unit = rig.config.safety.max_excursion, "m" if rig.config.is_linear else "rad"
        away = (rig.counts - rig.origin_counts) * rig.config.raw_resolution
        origin = rig.origin_counts * rig.config.raw_resolution
        here = {
            "key": "spring.origin",
            "before": origin,
            "after": origin + away,
            "unit": unit,
            "words": "the origin here",
        }
        if unknown := rig.position_unknown():
            reason = (
                "the device was opened again, and its encoder may have begun to count anew; set the spring's origin"
            )
            raise Refused("position_unknown", unknown, {"reason": reason, "remedies": [here], "force": False})
        if limit and abs(away) > limit:
            far = f"the shaft is {away:.4g} {unit} from the spring's origin, beyond safety.max_excursion = {limit:g} {unit}"
            reason = f"{far}; bring it back, or move the origin to it"
            raise Refused(
                "excursion", f"{reason}: 'hapticd origin'", {"reason": reason, "remedies": [here], "force": False}
            )

    def begin_recording(self, label: str, command: Command) -> None:
        """Record the run of a command, if ``record.enabled`` and the disk allow it; a failure does not prevent the run."""
        if not self.rig.config.record.enabled:
            return
        self.end_recording()
        with self._recording:
            try:
                self.rig.recorder.start(None, label)
                self._recorded = command
            except RecordingError as error:
                log.warning("this run is not recorded: %s", error)

    def end_recording(self) -> None:
        """End the recording of :meth:`begin_recording`; a recording that a client has started continues."""
        with self._recording:
            if self._recorded is not None:
                with contextlib.suppress(RecordingError):
                    self.rig.recorder.stop()
                self._recorded = None

    def leave_recording(self) -> None:
        """Mark the present recording as started by a client: :meth:`end_recording` does not end it."""
        self._recorded = None

    def records_revoked(self) -> bool:
        """Whether a run that a stop has ended is still being recorded."""
        recorded = self._recorded
        return recorded is not None and recorded.is_revoked()


def enforce(judgement: Judgement) -> JsonDict:
    """The guard's judgement as data; a warning is logged.

    Raises:
        Refused: the guard refuses.
    """
    if judgement.verdict == "refused":
        choice = {
            "reason": f"{judgement.reason}; nothing is started or changed",
            "remedies": list(judgement.remedies),
            "help": judgement.help,
            "force": True,
        }
        code = "limits" if judgement.trips else "unstable"
        raise Refused(code, refusal_text(choice, lambda name: name), choice)
    if judgement.verdict in ("forced", "warned"):
        log.warning("%s by the stability guard: %s", judgement.verdict, judgement.reason)
    return judgement.document
