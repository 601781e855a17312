"""Find an effect that another package brought; run as a program, in a process in which it is installed."""

from __future__ import annotations

import json
import math

import numpy as np

from hapticd.config.problems import ConfigError  # noqa: F401  the catalogue is complete once the config is there
from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap import find_gap
from tests.gap.synthetic import model, run

A, PLACE, WIDTH = 1.0e-3, 1.0, 2.0


def detent(angle: float, velocity: float, time: float) -> float:
    u = (angle - PLACE) / WIDTH
    return -A * u * math.exp(0.5 * (1.0 - u * u))


def main() -> None:
    """Print what was found as JSON."""
    recording = run(detent, 10.0, 3)
    result = find_gap([recording], model(), design=False)
    step = result.steps[0] if result.steps else None
    print(
        json.dumps(
            {
                "travel": float(np.ptp(recording.position)),
                "known": "magnetic_detent" in CATALOGUE,
                "effects": result.effects,
                "verdict": result.verdict,
                "statement": result.statement,
                "values": {name: estimate.value for name, estimate in step.parameters.items()} if step else {},
                "before": result.gap.held_out_before,
                "after": result.gap.held_out_after,
            }
        )
    )


if __name__ == "__main__":
    main()
