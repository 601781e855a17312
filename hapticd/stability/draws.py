"""Random draws of an uncertain plant (``plant.uncertainty``): inertia and frictions log-normal, the delay normal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.special import ndtri

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.config.sections import Uncertainty

PARAMETERS: Final = ("inertia", "viscous", "coulomb", "delay")
_SEED: Final = 1


def normals(uncertainty: Uncertainty, log2_draws: int) -> NDArray[np.float64]:
    """Standard normal errors of `PARAMETERS`, with the config's correlations, the same at every call.

    From a scrambled Sobol sequence; shape (2^log2_draws, 4).
    """
    from scipy.stats import qmc  # its import takes half a second, and only a config with uncertainty needs it

    uniform = qmc.Sobol(len(PARAMETERS), seed=_SEED).random_base2(log2_draws)
    values, vectors = np.linalg.eigh(np.asarray(uncertainty.matrix))
    root = vectors * np.sqrt(np.clip(values, 0.0, None))
    return np.asarray(ndtri(np.clip(uniform, 1e-9, 1.0 - 1e-9)) @ root.T)


def deviations(uncertainty: Uncertainty) -> NDArray[np.float64]:
    """Standard deviations of `PARAMETERS`, in their units."""
    return np.array([uncertainty.inertia, uncertainty.viscous, uncertainty.coulomb, uncertainty.delay_s])


def moved(value: float, error: float) -> float:
    """A value with a log-normal error, never negative; a value of 0 can only grow."""
    return value * float(np.exp(error / value)) if value > 0.0 else abs(error)
