"""The missing force of one recording at each sample, before and after, for the figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from hapticd.gap.arrays import Floats


@dataclass(frozen=True)
class Profile:
    """One recording of n samples.

    Attributes:
        name: file it came from. time_s: (n,). position: (n,) rad or m. velocity: (n,) rad/s or m/s.
        current: (n,) commanded, A.
        moves: (n,) whether the shaft moves, so that a force has a visible effect.
        before, after: (n,) missing force of the given and of the improved model, N m or N.
        deviation: (n,) standard deviation of `after`.
    """

    name: str
    time_s: Floats
    position: Floats
    velocity: Floats
    current: Floats
    moves: NDArray[np.bool_]
    before: Floats
    after: Floats
    deviation: Floats
