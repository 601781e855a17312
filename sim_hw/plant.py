"""A simulated device's plant, from a plant file of its own that the daemon does not see."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hapticd.config import Config, load_config
from hapticd.plant import kernel
from sim_hw import kinds, log
from sim_hw.layout import HAND_FROM, START_NS, Sim, new_sim
from sim_hw.motion import log_row, move_to

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from sim_hw.script import Script


def load_plant(path: str | Path | None) -> Config:
    """Read a plant file: a daemon's configuration of which ``plant``, ``hand``, ``amplifier`` and ``encoder`` count.

    Args:
        path: a file or the name of a preset; None is the built-in RE35 testbed.

    Raises:
        ConfigError: with everything that is wrong.
    """
    return load_config(path)


def new_plant(config: Config, position: float = 0.0) -> NDArray[np.float64]:
    """A plant's block (see :mod:`hapticd.plant.kernel`) without a DAC: the device does its own conversion.

    Args:
        config: what :func:`load_plant` read.
        position: true initial position, rad or m; the shaft is at rest there.
    """
    f = kernel.init_plant(config, position)
    f[kernel.DAC_STEP] = 0.0
    return f


def build_sim(config: Config, script: Script) -> Sim:
    """The compiled service's memory for a plant and a script; the device is switched on now."""
    start_ns = time.monotonic_ns()
    f = new_plant(config, script.position)
    f.view(np.int64)[kernel.TIME_NS] = start_ns
    sim = new_sim(f, script.hand_ns, script.hand_force, script.faults.copy(), start_ns, script.counts_offset)
    sim.s[HAND_FROM] = script.hand_from
    return sim


def begin_log(sim: Sim, script: Script) -> None:
    """The first row of a board's log, and that of a version it is made to lie about."""
    start_ns = int(sim.s[START_NS])
    log_row(sim, start_ns, log.START, 0, 0)
    if script.wrong_version is not None:
        log_row(sim, start_ns, log.FAULT_INJECTED, kinds.WRONG_VERSION, -1)


def end_log(sim: Sim, ns: int) -> None:
    """The last row of a board's log: when a command of an instant has reached the motor."""
    end = ns + math.ceil(sim.f[kernel.LAG_NS])
    move_to(sim, end)
    log_row(sim, end, log.END, 0, 0)
