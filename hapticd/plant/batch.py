"""Many shafts at once: the exact step over broadcast arrays, on all cores, bit for bit the scalar result."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapticd.jit import njit
from hapticd.plant.exact import propagate

_F = numba.types.Array(numba.float64, 1, "C")


@njit(numba.void(_F, _F, _F, _F, _F, _F, _F, _F, _F), parallel=True)
def _propagate_all(
    x: NDArray[Any],
    v: NDArray[Any],
    dt: NDArray[Any],
    force: NDArray[Any],
    inertia: NDArray[Any],
    viscous: NDArray[Any],
    coulomb: NDArray[Any],
    x_out: NDArray[Any],
    v_out: NDArray[Any],
) -> None:
    for k in numba.prange(len(x)):
        x_out[k], v_out[k] = propagate(x[k], v[k], dt[k], force[k], inertia[k], viscous[k], coulomb[k])


def propagate_batch(
    x: ArrayLike,
    v: ArrayLike,
    dt: ArrayLike,
    force: ArrayLike,
    inertia: ArrayLike,
    viscous: ArrayLike,
    coulomb: ArrayLike,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Exact step of every element (:func:`hapticd.plant.exact.propagate`), arguments broadcast against each other.

    Not to be called from two threads at once: Numba's fallback thread pool, used where neither OpenMP nor TBB is
    installed, ends the process on that.

    Args:
        x: positions [rad or m].
        v: velocities [rad/s or m/s].
        dt: durations [s].
        force: constant torques or forces [N m or N].
        inertia: inertias or masses [kg m² or kg].
        viscous: viscous friction [N m s/rad or N s/m].
        coulomb: Coulomb friction [N m or N].

    Returns:
        Positions and velocities after ``dt``, each of the broadcast shape.

    Raises:
        ValueError: the shapes do not broadcast.
    """
    arguments = np.broadcast_arrays(x, v, dt, force, inertia, viscous, coulomb)
    shape = arguments[0].shape
    # Copied, though nothing is written to them: to Numba a read-only array is another type.
    flat = [np.array(argument, dtype=np.float64, order="C").ravel() for argument in arguments]
    x_out, v_out = results = np.empty((2, flat[0].size))
    _propagate_all(*flat, *results)
    return x_out.reshape(shape), v_out.reshape(shape)
