"""Force and duration with which a hand moves a free shaft by a given displacement until it rests."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hapticd.plant import kernel

if TYPE_CHECKING:
    from hapticd.config import Config

_NS = 1_000_000_000
_LONGEST_S = 60.0
_HALVINGS = 40


def turning_force(config: Config, travel: float, seconds: float = 1.0) -> tuple[float, float]:
    """A constant force, and its duration, that moves a device from rest to rest by ``travel``.

    Args:
        config: plant and hand of the device. travel: rad or m, signed. seconds: rough duration of the force.

    Returns:
        N m or N, and s.

    Raises:
        ValueError: the device has no Coulomb friction, so that its position of rest is not determined.
    """
    plant = config.plant
    if plant.coulomb <= 0.0:
        raise ValueError("plant.coulomb is 0: a free shaft does not come to rest by itself")
    distance = abs(travel)
    force = plant.coulomb + plant.inertia * 2.0 * distance / seconds**2 + plant.viscous * distance / seconds
    low, high = 0.0, 4.0 * seconds
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _travelled(config, force, middle) > distance else (middle, high)
    return (force if travel > 0 else -force), low


def _travelled(config: Config, force: float, seconds: float) -> float:
    f = kernel.init_plant(config)
    i = f.view("i8")
    f[kernel.HAND_FORCE] = force
    kernel.plant_advance(f, i, round(seconds * _NS), 0.0)
    f[kernel.HAND_FORCE] = 0.0
    kernel.plant_advance(f, i, round((seconds + _LONGEST_S) * _NS), 0.0)
    return abs(float(f[kernel.POSITION]))
