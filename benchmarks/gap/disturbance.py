"""A torque that no catalogue knows, as every real machine has: an Ornstein–Uhlenbeck process on the shaft.

    dτ = −τ/T dt + s √(2/T) dW: standard deviation s, correlation ⟨τ(t) τ(t + h)⟩ = s² exp(−h/T).

Drawn with the exact transition over one step, from a seed of its own: whatever is hidden, played or recorded has no part
in it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.gap.physics import Device

SHARES = (0.05, 0.25)
"""Standard deviation over the device's Coulomb friction."""
CORRELATION_S = (0.01, 0.05, 0.2)
STEP_S = 2.5e-4
"""Linear in between, which takes 1.2 % off the variance at the shortest correlation time."""


class Coloured(NamedTuple):
    """One kind of disturbance."""

    share: float
    """Standard deviation over the device's Coulomb friction."""
    correlation_s: float


def drawn(std: float, correlation_s: float, duration_s: float, seed: int) -> NDArray[np.float64]:
    """Values at multiples of `STEP_S` from 0 to past the duration, shape (n,); the first is of the same law as the rest."""
    count = math.ceil(duration_s / STEP_S) + 2
    white = np.random.default_rng([seed, 0xC01]).normal(size=count)
    kept = math.exp(-STEP_S / correlation_s)
    white[1:] *= math.sqrt(1.0 - kept**2)
    return np.asarray(std * lfilter([1.0], [1.0, -kept], white), dtype=np.float64)


def disturbed(device: Device, coloured: Coloured | None, coulomb: float, duration_s: float, seed: int) -> Device:
    """The device with this torque on its shaft.

    Args:
        device: what is simulated.
        coloured: which disturbance; None for none.
        coulomb: friction of the nominal model, N m or N.
        duration_s: length of the recording.
        seed: of the torque.
    """
    if coloured is None:
        return device
    torque = drawn(coloured.share * coulomb, coloured.correlation_s, duration_s, seed)
    return device._replace(coloured=torque, coloured_step_s=STEP_S)
