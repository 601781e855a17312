"""Records of `hapticd.stability.energy_replay`: the model, its state, the energies.

SI units; positions from the spring's origin, J.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.stability.passivity import SIDES

if TYPE_CHECKING:
    from hapticd.config import Config

#: The device and its spring.
MODEL: Final = np.dtype(
    [
        ("inertia", "f8"),  # of device and hand, like the viscous friction
        ("viscous", "f8"),
        ("coulomb", "f8"),
        ("hand_stiffness", "f8"),
        ("hand_rest", "f8"),  # rest position of the hand's spring
        ("stiffness", "f8"),  # K
        ("tick", "f8"),  # Δ, coarse
        ("bias", "f8"),  # ½, or 0 without the half tick
        ("side", "f8"),  # of a wall: 1 positive, −1 negative; 0 for both
        ("count", "f8"),  # the raw resolution
        ("origin", "i8"),  # raw count of the spring's origin
        ("torque_constant", "f8"),
        ("lag", "f8"),  # T_A and the driver's latency
        ("within_period", "f8"),  # T_V modulo the period
    ],
    align=True,
)
#: Energies since the start. They balance: stored = start − viscous − coulomb + generated + unexplained + settings.
ENERGIES: Final = np.dtype(
    [
        ("stored", "f8"),  # H_T (35)
        ("start", "f8"),  # stored at the start
        ("viscous", "f8"),  # dissipated by viscous friction
        ("coulomb", "f8"),  # by Coulomb friction
        ("generated", "f8"),  # by sampling, quantisation and delay
        ("unexplained", "f8"),  # work of the hand, and model errors
        ("settings", "f8"),  # work of changed settings
        ("put_out", "f8"),  # of the passivity observer: work of the current between the counts
        ("observed", "f8"),  # the part of it that the spring had not stored
    ]
)
#: Positions of the mass: when the row was read; and while its force acted, at start, end, minimum and maximum.
POSITIONS: Final = np.dtype([(name, "f8") for name in ("sampled", "start", "end", "low", "high")])
#: A force that does not act yet: the time from which it acts, and its row.
COMMAND: Final = np.dtype([("time", "f8"), ("force", "f8"), ("row", "i8")])
QUEUE_LENGTH: Final = 4096
#: State from row to row.
REPLAY: Final = np.dtype(
    [
        ("model", MODEL),
        ("energies", ENERGIES),
        ("time", "f8"),  # of the model
        ("position", "f8"),
        ("velocity", "f8"),
        ("force", "f8"),  # that acts
        ("acting", "i8"),  # its row, counted in this call; −1 if of an earlier call
        ("began", "i8"),  # rows before this call
        ("rows", "i8"),
        ("tick", "i8"),  # of the last row, like the next four
        ("counts", "i8"),  # from the spring's origin
        ("current", "f8"),
        ("running", "?"),
        ("excited", "?"),
        ("seen", "?"),  # whether there was a row
        ("head", "i8"),  # commands put into the queue
        ("tail", "i8"),  # commands taken out
        ("queue", COMMAND, QUEUE_LENGTH),
    ],
    align=True,
)


def model_of(config: Config, latency_s: float = 0.0, origin_counts: int | None = None) -> NDArray[Any]:
    """The model of a config, () of `MODEL`.

    Args:
        config: a resolved configuration. latency_s: the driver's declared latency.
        origin_counts: raw count of the spring's present origin; None: the config's.
    """
    model = np.zeros((), MODEL)
    raw, origin = config.raw_resolution, config.origin_counts if origin_counts is None else origin_counts
    model["inertia"] = config.plant.inertia + config.hand.inertia
    model["viscous"] = config.plant.viscous + config.hand.damping
    model["coulomb"] = config.plant.coulomb
    model["hand_stiffness"] = config.hand.stiffness
    model["hand_rest"] = (config.origin_counts - origin) * raw
    model["stiffness"], model["tick"] = config.spring.stiffness, config.resolution
    model["bias"] = 0.5 if config.spring.half_tick_bias else 0.0
    model["side"] = SIDES[config.spring.side]
    model["count"], model["origin"] = raw, origin
    model["torque_constant"] = config.amplifier.torque_constant
    model["lag"] = config.amplifier.delay + latency_s
    periods = config.delay.computation_s / config.period
    # rounding must not move a delay of whole periods below that number
    model["within_period"] = max(0.0, periods - math.floor(periods + 1e-6)) * config.period
    return model
