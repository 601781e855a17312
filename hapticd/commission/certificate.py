"""What is left of a rig's first day as data: config digest, versions, figures, limits, and what was skipped."""

from __future__ import annotations

import platform
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, Final

from hapticd.commission.step import skipped
from hapticd.commission.steps import STEPS
from hapticd.config import config_digest
from hapticd.record.metadata import utc_now

if TYPE_CHECKING:
    from hapticd.commission.rig import Rig

FILE: Final = "commission.json"
OPTIONAL: Final = ("torque_constant", "watchdog", "latency", "current_loop", "gap", "stiffness")
"""Steps that may be skipped for want of something to look at, and the rig passes nevertheless."""


def certificate(rig: Rig) -> dict[str, Any]:
    """The keys of ``hapticd commission --json``."""
    steps = []
    for step in STEPS:
        result = rig.results.get(step.name) or skipped("not done yet")
        steps.append(
            {
                "name": step.name,
                "title": step.title,
                "will": step.will,
                "result": result.result,
                "figures": dict(result.figures),
                "limit": dict(result.limit),
                "skipped": result.finding if result.result == "skipped" else None,
                "finding": result.finding,
                "cause": result.cause,
                "remedy": result.remedy,
            }
        )
    optional = OPTIONAL if rig.config.safety.enable else (*OPTIONAL, "enable")
    left = [each["name"] for each in steps if each["result"] == "skipped"]
    failed = [each["name"] for each in steps if each["result"] == "fail"]
    disturbed = [each["name"] for each in steps if each["result"] == "disturbed"]
    return {
        "passed": not failed and not disturbed and all(name in optional for name in left),
        "failed": failed,
        "disturbed": disturbed,
        "skipped": left,
        "steps": steps,
        "rig_s": round(rig.seconds, 1),
        "config_digest": config_digest(rig.config),
        "driver": rig.config.driver.name,
        "made": utc_now().isoformat(" ", "seconds"),
        "versions": {
            "hapticd": version("hapticd"),
            "numpy": version("numpy"),
            "numba": version("numba"),
            "python": platform.python_version(),
            "kernel": platform.release(),
            "machine": platform.node(),
        },
    }
