"""What `hapticd.stability.energy_replay` works with, as records: the model, what moves in it, what is booked.

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
        ("inertia", "f8"),  # with the hand's, as the viscous friction
        ("viscous", "f8"),
        ("coulomb", "f8"),
        ("hand_stiffness", "f8"),
        ("hand_rest", "f8"),  # where the hand's spring is relaxed
        ("stiffness", "f8"),  # K
        ("tick", "f8"),  # Δ, coarse
        ("bias", "f8"),  # ½, or 0 without the half tick
        ("side", "f8"),  # of a wall: 1 positive, −1 negative; 0 for both
        ("count", "f8"),  # the raw resolution
        ("origin", "i8"),  # raw count of the spring's origin
        ("torque_constant", "f8"),
        ("lag", "f8"),  # T_A and the driver's latency
        ("within_period", "f8"),  # what T_V is beyond whole periods
    ],
    align=True,
)
#: Energies since the start. They balance: stored = start − viscous − coulomb + generated + unexplained + settings.
ENERGIES: Final = np.dtype(
    [
        ("stored", "f8"),  # H_T (35)
        ("start", "f8"),  # what was stored at the start
        ("viscous", "f8"),  # dissipated by viscous friction
        ("coulomb", "f8"),  # by Coulomb friction
        ("generated", "f8"),  # by sampling, quantisation and delay
        ("unexplained", "f8"),  # a hand's work and the model's errors
        ("settings", "f8"),  # work of changed settings
        ("put_out", "f8"),  # what the passivity observer sees: the current's work on the way between the counts
        ("observed", "f8"),  # and what of that the spring had not stored
    ]
)
#: Where the mass was: when the row was read; and while its force acted, at start and end and at the extremes.
PLACES: Final = np.dtype([(name, "f8") for name in ("sampled", "start", "end", "low", "high")])
#: A force on its way: from when it acts, and of which row.
COMMAND: Final = np.dtype([("time", "f8"), ("force", "f8"), ("row", "i8")])
QUEUE_LENGTH: Final = 4096
#: All that is kept from row to row.
REPLAY: Final = np.dtype(
    [
        ("model", MODEL),
        ("energies", ENERGIES),
        ("time", "f8"),  # up to which the model has moved
        ("position", "f8"),
        ("velocity", "f8"),
        ("force", "f8"),  # that acts, and
        ("acting", "i8"),  # the row it is of, counted in this call; −1 where that is not of it
        ("began", "i8"),  # rows before this call
        ("rows", "i8"),
        ("tick", "i8"),  # of the last row, as the next four
        ("counts", "i8"),  # from the spring's origin
        ("current", "f8"),
        ("running", "?"),
        ("excited", "?"),
        ("seen", "?"),  # whether there was one
        ("head", "i8"),  # commands put into the queue, and
        ("tail", "i8"),  # taken out of it
        ("queue", COMMAND, QUEUE_LENGTH),
    ],
    align=True,
)


def model_of(config: Config, latency_s: float = 0.0, origin_counts: int | None = None) -> NDArray[Any]:
    """The model of a config, () of `MODEL`.

    Args:
        config: a resolved configuration. latency_s: the driver's declared latency.
        origin_counts: raw count of the spring's origin in force; None: the config's.
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
    # a delay of whole periods must not become one of a whole period less a rounding
    model["within_period"] = max(0.0, periods - math.floor(periods + 1e-6)) * config.period
    return model
