"""First guess of every window's initial position and velocity: a local parabola through the samples around its start.

The guess only has to fall into the basin of the fit (`hapticd.gap.fit.fit_states`), which then finds the state that
predicts the window best under the model at hand.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import savgol_filter

if TYPE_CHECKING:
    from numpy.typing import NDArray

_HALF_WIDTH = 8


def smooth_motion(
    position: NDArray[np.float64], period_s: float, half_width: int = _HALF_WIDTH
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position and velocity (n,) from local parabolas over 2·`half_width` + 1 samples (Savitzky and Golay 1964)."""
    width = min(2 * half_width + 1, (len(position) - 1) // 2 * 2 + 1)
    smooth = savgol_filter(position, width, 2, mode="interp")
    velocity = savgol_filter(position, width, 2, deriv=1, delta=period_s, mode="interp")
    return np.asarray(smooth), np.asarray(velocity)
