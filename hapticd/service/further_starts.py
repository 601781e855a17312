"""Further exploration of a rendered spring that no theorem covers: if a start does not come to rest, the force fades out.

The guard searches for 0.1 s before a motion begins (`hapticd.stability.guard.judge`). Here the same search continues with
10 % of one core while the spring is rendered, until enough starts were tried. The servo loop has a higher priority, and
the search releases the GIL.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Final

from hapticd.service.background import Background
from hapticd.servo import faults, layout
from hapticd.stability.guard import explore_further, same_loop

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.service.rendering import Rendering

log = logging.getLogger(__name__)

ENOUGH: Final = 1 << 16
"""Most starts for one spring and motion."""


class FurtherStarts:
    """The search for the rendered spring.

    Args:
        rendering: the rendered spring, and the motion for which it was admitted.

    Raises:
        RuntimeError: a thread cannot be created.
    """

    def __init__(self, rendering: Rendering) -> None:
        self._rendering = rendering
        self._judged: tuple[Config, float | None, bool] | None = None
        self._tried: int | None = 0
        self._background = Background("hapticd-explore")

    def alive(self) -> dict[str, bool]:
        """Name of its thread to whether it runs."""
        return {"hapticd-explore": self._background.alive()}

    def go_on(self) -> None:
        """Try some more starts in the background; returns at once. Called about once a second."""
        if self._rendering.rig.state == layout.RUNNING and not self._background.busy():
            self._background.ask(self._try)

    def _try(self) -> None:
        rig, judged = self._rendering.rig, self._rendering.judged
        rendered, latency_s = rig.request, rig.driver.latency_s
        # The last judged config may not have been applied; then the one before it is rendered.
        if judged is None or not same_loop(judged[0], rig.config, latency_s):
            judged = self._judged
        if judged is None or not same_loop(judged[0], rig.config, latency_s):
            return
        if judged != self._judged:
            self._judged, self._tried = judged, 0
        config, deflection, admitted = judged
        if not admitted or self._tried is None or self._tried >= ENOUGH:
            return
        found = explore_further(config, latency_s, deflection=deflection, skip=self._tried)
        if found is None or not found.starts:
            self._tried = None
            return
        self._tried += found.starts
        if found.moving_on and found.worst_start is not None:
            log.warning("the spring is taken back: %s. %s", found.words, found.command(config.period))
            rig.fade_out(rendered, (faults.UNSTABLE, *found.worst_start))
