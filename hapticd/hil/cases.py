"""The experiments of the suite: the paper's four releases (Fig. 8), and an excitation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Case:
    """One release of Fig. 8."""

    name: str
    rate_hz: float
    decimation: int
    deflection: float
    """Coarse ticks."""
    duration_s: float
    paper: str
    """What the paper's rig did, and simulation does: ``decaying``, ``persistent`` or ``growing``."""

    @property
    def settings(self) -> dict[str, float]:
        """Live settings that make the case, on any device."""
        return {"servo.rate_hz": self.rate_hz, "encoder.decimation": self.decimation}


FIG_8: Final = (
    Case("a", 1000.0, 217, 20.3, 1.2, "decaying"),
    Case("b", 1000.0, 2172, 3.3, 3.0, "persistent"),
    Case("c", 100.0, 217, 2.3, 1.0, "decaying"),
    Case("d", 100.0, 217, 10.3, 3.0, "growing"),
)

EXCITATION: Final = "steps"
EXCITATION_S: Final = 4.0
EXCITATION_SPAN_S: Final = 0.25
"""Time over which the excited run is compared: two steps. Later the two runs part as any two runs of the rig do."""
