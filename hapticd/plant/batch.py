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

    Returns:
        Positions and velocities after ``dt``, each of the broadcast shape.

    Raises:
        ValueError: the shapes do not broadcast.
    """
    arguments = np.broadcast_arrays(x, v, dt, force, inertia, viscous, coulomb)
    shape = arguments[0].shape
    flat = [np.ascontiguousarray(argument, dtype=np.float64).ravel() for argument in arguments]
    x_out, v_out = np.empty(flat[0].size), np.empty(flat[0].size)
    _propagate_all(*flat, x_out, v_out)
    return x_out.reshape(shape), v_out.reshape(shape)
