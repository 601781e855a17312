"""The daemon's status in one document: the loop's atomics, the recorder, and the theory."""

from __future__ import annotations

import math
import time
from dataclasses import asdict
from typing import TYPE_CHECKING

from hapticd.config import Config, config_digest
from hapticd.config.limits import limits_off
from hapticd.control.endpoints import JsonDict
from hapticd.servo import atomics, layout
from hapticd.stability import numbers, regions

if TYPE_CHECKING:
    from hapticd.service.recent import RecentTiming
    from hapticd.service.rig import Rig


def status(
    rig: Rig, fault: JsonDict | None, experiment: JsonDict, recent: RecentTiming, lines_dropped: int
) -> JsonDict:
    """The daemon's state as JSON-ready values; waits for nothing."""
    config = rig.config
    snapshot = rig.core.snapshot
    recorder = rig.recorder.status()
    return {
        "state": layout.STATE_NAMES[rig.state],
        "fault": fault,
        "config_digest": config_digest(config),
        "timing": _timing(rig, recent),
        "operating_point": _operating_point(rig),
        "enable": {"required": config.safety.enable, "held": rig.held if rig.driver.enable_input else None},
        "position_unknown": rig.position_unknown(),
        "position": (rig.counts - rig.origin_counts) * config.raw_resolution,
        "velocity": float(snapshot["velocity"]),
        "current": float(snapshot["current"]),
        "current_measured": _finite(float(snapshot["current_measured"])),
        "force": float(snapshot["force"]),
        "position_ticks": float(snapshot["position"]),
        "encoder_counts": rig.counts,
        "origin_counts": rig.origin_counts,
        "settings_epoch": rig.settings_epoch,
        "latency_s": rig.driver.latency_s,
        "units": _units(config),
        "energy": rig.energy.status(),
        "passivity": _passivity(rig),
        "exchanges_missed": rig.core.load(atomics.MISSED_EXCHANGES),
        "commands_clamped": rig.core.load(atomics.CLAMPED),
        "limits_off": limits_off(config),
        "log_lines_dropped": lines_dropped,
        "realtime": [asdict(grant) for grant in rig.grants],
        "recorder": recorder,
        "experiment": experiment,
    }


def _timing(rig: Rig, recent: RecentTiming) -> JsonDict:
    """Timing statistics since the start, and of the last seconds."""
    rate_hz = rig.config.servo.rate_hz
    return {"rate_hz": rate_hz, **recent.statistics(rig.core, time.monotonic(), rate_hz)}


def _passivity(rig: Rig) -> JsonDict:
    """Energies of the passivity observer since the start; null if it is off."""
    mode = rig.config.safety.passivity
    return {"mode": mode, **(rig.core.passivity() if mode != "off" else dict.fromkeys(rig.core.passivity()))}


def _operating_point(rig: Rig) -> JsonDict:
    point = numbers.from_config(rig.config, rig.driver.latency_s)
    return {
        **{name: _finite(getattr(point, name)) for name in ("mu", "beta", "sigma", "tau_d")},
        "region": regions.region(point),
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _units(config: Config) -> JsonDict:
    length, force = ("m", "N") if config.is_linear else ("rad", "N m")
    return {"position": length, "velocity": f"{length}/s", "current": "A", "force": force}
