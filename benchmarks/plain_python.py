"""The peer of ``simulate``: the same tick, spring and exact plant as a plain Python loop, without a compiler.

``python -m benchmarks.plain_python TICKS`` sets NUMBA_DISABLE_JIT for itself, runs case a of Fig. 8 over and over and
prints JSON: ``ticks_per_s`` and ``position_ticks``, the end of the case, which must be that of the compiled loop.
"""

from __future__ import annotations

import json
import math
import os
import sys
import time

os.environ["NUMBA_DISABLE_JIT"] = "1"

from hapticd.config import Config, parse_config
from hapticd.plant.exact import propagate

CASE_A = {
    "encoder": {"decimation": 217},
    "amplifier": {"bandwidth_hz": 0, "dac_bits": 0},
}
DEFLECTION = 20.3
CASE_TICKS = 1000


def case_a(config: Config) -> float:
    """One release: the final position in coarse ticks."""
    plant, raw, decimation = config.plant, config.raw_resolution, config.encoder.decimation
    constant, period = config.amplifier.torque_constant, config.period
    position, velocity = DEFLECTION * config.resolution, 0.0
    rows = []
    for tick in range(CASE_TICKS):
        counts = math.floor(position / raw)
        ticks = counts // decimation
        force = -config.spring.stiffness * config.resolution * (ticks + 0.5)
        current = force / constant
        rows.append((tick, tick * period, counts, ticks, current, current, force, 0, 0, 1))
        position, velocity = propagate(
            position, velocity, period, current * constant, plant.inertia, plant.viscous, plant.coulomb
        )
    return position / config.resolution


if __name__ == "__main__":
    wanted = int(sys.argv[1])
    testbed = parse_config(CASE_A, "benchmark")
    done, end, begin = 0, math.nan, time.perf_counter()
    while done < wanted:
        end = case_a(testbed)
        done += CASE_TICKS
    print(json.dumps({"ticks_per_s": done / (time.perf_counter() - begin), "position_ticks": end}))
