"""What befalls frames by the script: lost, late, twice, damaged, out of order."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from tests.drivers.other_drive.wires import Frame

FRAME_KINDS: Final = ("drop", "corrupt", "duplicate", "delay", "reorder")
KINDS: Final = (
    *(*FRAME_KINDS, "garbage", "freeze_counter", "encoder_glitch", "unplug", "silent", "wrong_version", "bus_off"),
    *("emcy", "leave_operation_enabled", "reboot", "encoder_fault", "amplifier_fault", "external_stop"),
    *("measured_current", "second_node", "foreign_sdo", "enable_released"),
)
"""As the log counts them."""


class FrameTrouble:
    """One fault that hits frames, from its instant on."""

    def __init__(self, fault: Mapping[str, Any]) -> None:
        self._kind = fault["kind"]
        self._frames = fault.get("frames", "any")
        self._left = int(fault.get("count", 1))
        self._late_ns = round(1e9 * fault.get("delay_s", 0.0))
        self._held: tuple[str, Frame] | None = None
        self.number = KINDS.index(self._kind)

    def hits(self, kind: str) -> bool:
        """Whether it has something to do with a frame of that kind."""
        return self._frames in (kind, "any") and (self._left > 0 or (self._held is not None and self._held[0] == kind))

    def change(self, kind: str, frame: Frame) -> Iterator[tuple[int, Frame]]:
        """What comes of a frame that it hits: frames, each with how late it is in ns."""
        if self._held is not None:
            yield 0, frame
            yield 0, self._held[1]
            self._held = None
            return
        self._left -= 1
        if self._kind == "reorder":
            self._held = (kind, frame)
        elif self._kind == "corrupt":
            yield 0, frame._replace(data=frame.data[:-1] if frame.data else b"\xff")
        elif self._kind != "drop":
            for _ in range(2 if self._kind == "duplicate" else 1):
                yield self._late_ns, frame
