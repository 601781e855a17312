"""Many shafts at once are the same numbers as one at a time."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.plant.batch import propagate_batch
from hapticd.plant.exact import propagate


def test_a_batch_is_the_scalar_step_bit_for_bit() -> None:
    random = np.random.default_rng(7)
    n = 20_000
    x, v = random.normal(size=n), random.choice([0.0, 1.0], n) * random.normal(size=n)
    dt, force = random.uniform(0.0, 20.0, n), random.choice([0.0, 1.0], n) * random.normal(size=n)
    inertia, viscous = 10 ** random.uniform(-1, 3, n), random.choice([0.0, 1e-9, 0.1, 5.0], n)
    coulomb = random.choice([0.0, 0.5, 2.0], n)
    positions, velocities = propagate_batch(x, v, dt, force, inertia, viscous, coulomb)
    rows = zip(x, v, dt, force, inertia, viscous, coulomb, strict=True)
    expected = np.array([propagate(*map(float, row)) for row in rows])
    assert positions.tobytes() == expected[:, 0].tobytes()
    assert velocities.tobytes() == expected[:, 1].tobytes()


def test_arguments_broadcast_to_a_grid() -> None:
    beta, sigma = np.linspace(0.0, 1.5, 4), np.linspace(0.0, 3.0, 3)
    x, v = propagate_batch(0.0, 5.0, 1.0, -0.5, 100, beta[:, None], sigma)
    assert x.shape == v.shape == (4, 3)
    assert (x[2, 1], v[2, 1]) == propagate(0.0, 5.0, 1.0, -0.5, 100.0, beta[2], sigma[1])


@pytest.mark.parametrize("shape", [(), (0,), (2, 0), (1, 1, 1)])
def test_any_shape_comes_back(shape: tuple[int, ...]) -> None:
    x, v = propagate_batch(np.zeros(shape), 1.0, 1.0, 0.0, 1.0, 0.0, 0.0)
    assert x.shape == v.shape == shape
    assert np.all(x == 1.0)


@pytest.mark.parametrize("writeable", [True, False])
def test_inputs_are_left_alone(writeable: bool) -> None:
    x = np.ones(3)
    x.flags.writeable = writeable
    moved, _ = propagate_batch(x, 1.0, 1.0, 0.0, 1.0, 0.0, 0.0)
    assert np.array_equal(moved, np.full(3, 2.0))
    assert np.array_equal(x, np.ones(3))


def test_shapes_that_do_not_broadcast_are_refused() -> None:
    with pytest.raises(ValueError, match="broadcast"):
        propagate_batch(np.zeros(3), np.zeros(2), 1.0, 0.0, 1.0, 0.0, 0.0)
