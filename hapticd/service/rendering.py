"""The rig in force, and what begins and ends its motion: the guard, the run token, the recording of a run.

One for one daemon, shared by its commands, its experiments and its fault manager.
"""

from __future__ import annotations

import contextlib
import logging
from typing import TYPE_CHECKING

from hapticd.record import RecordingError
from hapticd.service.refusals import DriverFailure, Refused
from hapticd.servo import layout
from hapticd.stability.guard import Judgement, judge

if TYPE_CHECKING:
    from collections.abc import Callable

    from hapticd.config import Config
    from hapticd.control.endpoints import JsonDict
    from hapticd.service.rig import Rig

log = logging.getLogger(__name__)

ANSWER_S = 1.0
"""The loop answers within a tick; longer than this, and it does not."""


class Rendering:
    """Begins and ends motion on the rig in force.

    Attributes:
        rig: the rig in force; a reload replaces it.
    """

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self._records = False

    def admit(
        self, config: Config, deflection: float | None, *, release: bool = False, force: bool = False
    ) -> JsonDict:
        """Ask the guard about a config, and a motion from rest at a deflection in coarse ticks; its answer as data.

        Raises:
            Refused: the motion would not die out.
        """
        latency_s = self.rig.driver.latency_s
        return enforce(judge(config, latency_s, deflection=deflection, release=release, force=force))

    def switch_off(self) -> int:
        """Amplifier off, the recording of a run ended; returns a run token."""
        token = self.rig.halt()
        self.rig.wait(lambda: self.rig.state == layout.OFF, ANSWER_S)
        self.end_recording()
        return token

    def run(self, token: int, refuse_fault: Callable[[], None]) -> None:
        """Request ``running`` and wait until the loop renders, or reports why it does not.

        Args:
            token: of :meth:`Rig.run_token`, from before the command was looked at.
            refuse_fault: raises what a latched fault is refused with.

        Raises:
            Refused: stopped meanwhile, or a fault.
            DriverFailure: the loop does not begin to render.
        """
        rig = self.rig
        timeout = (rig.config.safety.enable_timeout_s or 60.0) + ANSWER_S
        if rig.run(token):
            rig.wait(lambda: rig.state in (layout.RUNNING, layout.FAULT) or rig.is_revoked(token), timeout)
        if rig.is_revoked(token):
            raise Refused("stopped", "stopped before it began")
        if rig.state == layout.FAULT:
            refuse_fault()
        if rig.state != layout.RUNNING:
            rig.halt()
            raise DriverFailure(f"the servo loop did not begin to render within {timeout:g} s")

    def refuse_place(self) -> None:
        """Refuse to render where the origin's place is not known, or beyond ``safety.max_excursion`` from the shaft."""
        rig = self.rig
        limit, unit = rig.config.safety.max_excursion, "m" if rig.config.is_linear else "rad"
        away = (rig.counts - rig.origin_counts) * rig.config.raw_resolution
        if unknown := rig.position_unknown():
            raise Refused("position_unknown", unknown)
        if limit and abs(away) > limit:
            here = rig.counts * rig.config.raw_resolution
            raise Refused(
                "excursion",
                f"the shaft is {away:.4g} {unit} from the spring's origin, beyond safety.max_excursion = {limit:g} {unit}; "
                f"bring it back, or move the origin to it: 'hapticd set spring.origin={here:.4g}'",
            )

    def begin_recording(self, label: str) -> None:
        """Record this run, if ``record.enabled`` and the disk allow; it is never a reason not to run."""
        if not self.rig.config.record.enabled:
            return
        try:
            self.rig.recorder.start(None, label)
            self._records = True
        except RecordingError as error:
            log.warning("this run is not recorded: %s", error)

    def end_recording(self) -> None:
        """End what :meth:`begin_recording` began; a recording that was asked for goes on."""
        if self._records:
            self._records = False
            with contextlib.suppress(RecordingError):
                self.rig.recorder.stop()

    def leave_recording(self) -> None:
        """What is being recorded now was asked for: :meth:`end_recording` leaves it alone."""
        self._records = False


def enforce(judgement: Judgement) -> JsonDict:
    """What the guard says, as data; a warning goes into the log.

    Raises:
        Refused: the guard refuses.
    """
    if judgement.verdict == "refused":
        raise Refused(
            "unstable",
            f"{judgement.reason}; nothing is started or changed\n{judgement.help}\n"
            "Render it all the same: --force (API: force)",
        )
    if judgement.verdict in ("forced", "warned"):
        log.warning("%s by the stability guard: %s", judgement.verdict, judgement.reason)
    return judgement.document
