"""A simulated device's plant, from a separate plant file that the daemon does not read."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

import numpy as np

from hapticd.plant import kernel
from sim_hw import layout as w
from sim_hw import log
from sim_hw._motion import log_row, move_to

if TYPE_CHECKING:
    from hapticd.config import Config
    from sim_hw.script import Script


def build_sim(config: Config, script: Script) -> w.Sim:
    """The compiled service's memory for a plant and a script; the device is switched on now, with the shaft at rest.

    The plant has no DAC, because the device has one.
    """
    start_ns = time.monotonic_ns()
    f = kernel.init_plant(config, script.position)
    f[kernel.DAC_STEP] = 0.0
    f.view(np.int64)[kernel.TIME_NS] = start_ns
    s = np.zeros(w.STATE_WORDS, np.int64)
    s[w.START_NS], s[w.ENABLED_NS], s[w.RANDOM] = start_ns, w.FAR_NS, 1
    s[w.COUNTS_OFFSET], s[w.HAND_FROM] = script.counts_offset, script.hand_from
    s.view(np.float64)[w.CURRENT_GAIN], s[w.NO_WATCHDOG] = script.current_gain, 1 - script.watchdog
    ring = np.zeros(w.RING_ROWS, log.ROW)
    held = np.zeros((w.HELD_SLOTS, w.HELD_WORDS), np.int64)
    held_bytes = np.zeros((w.HELD_SLOTS, w.HELD_BYTES), np.uint8)
    hand, faults = (script.hand_ns, script.hand_force), script.faults.copy()
    return w.Sim(s, s.view(np.float64), f, f.view(np.int64), ring, *hand, faults, held, held_bytes)


def end_log(sim: w.Sim, ns: int) -> None:
    """Write the last row of a board's log, when a command of an instant has reached the motor."""
    end = ns + math.ceil(sim.f[kernel.LAG_NS])
    move_to(sim, end)
    log_row(sim, end, log.END, 0, 0)
