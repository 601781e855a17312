"""The experiments of the suite: the paper's four releases (Fig. 8), and an excitation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

from hapticd.config import Config, apply_settings
from hapticd.hil.errors import HilError


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


FIRMWARE_RATE_HZ: Final = 200.0
"""An emulated processor is no faster: what it shows is right, and not how soon."""
FIRMWARE_CONFIG: Final[dict[str, Any]] = {
    "servo": {"rate_hz": 1000.0},
    "driver": {"name": "serial_dac", "port": "the firmware's", "latency_s": 0.0013},
}
"""The built-in testbed on the firmware in emulation. The delay is what emulation takes (`hapticd hil --device firmware`)."""


def slower_case(case: Case, rate_hz: float) -> Case:
    """The case at another rate, its time stretched with the period."""
    return replace(case, rate_hz=rate_hz, duration_s=case.duration_s * case.rate_hz / rate_hz)


def slower_rig(config: Config, from_hz: float, rate_hz: float) -> Config:
    """A rig that is at ``rate_hz`` what the config's is at ``from_hz``: the same μ, β, σ, τ_D (Table I) and limits.

    With s = T'/T: inertia s² m, viscous friction s b, virtual damping s B with its cut-off f/s, amplifier lag s T_A; speeds
    become slower by s. The delay of the driver is the device's own, and stays.

    Raises:
        HilError: the plant has effects, whose parameters have no such rule.
        ConfigError: a number of the slower rig is beyond a limit of the schema.
    """
    if config.plant.effects:
        raise HilError("plant.effects: cannot be brought to another rate; leave them out for --device firmware")
    s = from_hz / rate_hz
    spring, plant, hand = config.spring, config.plant, config.hand
    slower = {
        "servo.rate_hz": rate_hz,
        "spring.damping": s * spring.damping,
        "spring.velocity_cutoff_hz": spring.velocity_cutoff_hz / s,
        "delay.computation_s": s * config.delay.computation_s,
        "plant.inertia": s * s * plant.inertia,
        "plant.viscous": s * plant.viscous,
        "hand.inertia": s * s * hand.inertia,
        "hand.damping": s * hand.damping,
        "amplifier.bandwidth_hz": config.amplifier.bandwidth_hz / s,
        "safety.max_velocity": config.safety.max_velocity and config.safety.max_velocity / s,
    }
    return apply_settings(config, slower, source=f"the rig at {rate_hz:g} Hz")
