"""One device as a flat float64 vector: the base model's words, then the words of every effect.

An effect that a device does not have is in the vector at its neutral value, which switches its law off. A list parameter
takes one word an element: ``torque_ripple.amplitudes[2]``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hapticd.config.effect_parameters import EFFECT_PARAMETERS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.config import Config

BASE_WORDS = (
    "inertia",  # of the device, kg m² or kg
    "viscous",  # N m s/rad or N s/m
    "coulomb",  # N m or N
    "torque_constant",  # N m/A or N/A
    "delay_s",  # from command to current: T_A and the driver's latency
    "grip_inertia",  # config.hand: a grip that never lets go
    "grip_damping",
    "grip_stiffness",
    "grip_rest",
    "external_force",  # N m or N, constant during a step
)

STATE = 8
"""Words of the mechanical state."""
THETA = 0
"""Shaft (motor) position, rad or m."""
OMEGA = 1
"""Shaft velocity."""
BRISTLE = 2
"""Deflection z of the LuGre bristle, rad or m."""
LOAD_THETA = 3
"""Position of the load behind a backlash or a flexible coupling."""
LOAD_OMEGA = 4
"""Velocity of the load."""
CONTACT = 5
"""Side of the backlash that is in contact: +1 the motor pushes the load forwards, −1 backwards, 0 none."""
MOTOR_CURRENT = 6
"""Current behind the current loop of `amplifier_lag`, A; used where commands come one by one."""
MOTOR_CURRENT_RATE = 7
"""Its derivative, A/s."""


def _names() -> tuple[str, ...]:
    names = list(BASE_WORDS)
    for slug, parameters in EFFECT_PARAMETERS.items():
        for parameter in parameters:
            key = f"{slug}.{parameter.name}"
            names += [key] if parameter.length == 1 else [f"{key}[{k}]" for k in range(parameter.length)]
    return tuple(names)


WORDS: tuple[str, ...] = _names()
"""Name of every word, in order."""
_INDEX = {name: index for index, name in enumerate(WORDS)}
SIZE = len(WORDS)
"""Words of a device vector."""


def word(name: str) -> int:
    """Index of a word: ``inertia``, ``stribeck.s``, ``torque_ripple.orders[0]`` (a list's bare name is its first).

    Raises:
        KeyError: there is no such word.
    """
    return _INDEX[name] if name in _INDEX else _INDEX[f"{name}[0]"]


def neutral_vector() -> NDArray[np.float64]:
    """A vector of shape (SIZE,) with zeros for the base and every effect off."""
    p = np.zeros(SIZE)
    for slug, parameters in EFFECT_PARAMETERS.items():
        for parameter in parameters:
            first = word(f"{slug}.{parameter.name}")
            p[first : first + parameter.length] = parameter.neutral
    return p


def device_vector(config: Config, latency_s: float = 0.0) -> NDArray[np.float64]:
    """The vector of a config's plant with its effects, amplifier and hand.

    Args:
        config: resolved configuration.
        latency_s: sample-to-current latency of the driver, added to the amplifier's T_A.

    Returns:
        Shape (SIZE,), float64.
    """
    p = neutral_vector()
    p[word("inertia")] = config.plant.inertia
    p[word("viscous")] = config.plant.viscous
    p[word("coulomb")] = config.plant.coulomb
    p[word("torque_constant")] = config.amplifier.torque_constant
    p[word("delay_s")] = config.amplifier.delay + latency_s
    p[word("grip_inertia")] = config.hand.inertia
    p[word("grip_damping")] = config.hand.damping
    p[word("grip_stiffness")] = config.hand.stiffness
    p[word("grip_rest")] = config.origin_counts * config.raw_resolution
    for effect in config.plant.effects:
        for name, value in (effect.model_extra or {}).items():
            values = np.atleast_1d(np.asarray(value, dtype=np.float64))
            first = word(f"{effect.name}.{name}")
            p[first : first + len(values)] = values
    return p


def initial_state(position: float = 0.0, velocity: float = 0.0) -> NDArray[np.float64]:
    """A mechanical state of shape (STATE,): shaft and load together, bristle relaxed, play centred."""
    state = np.zeros(STATE)
    state[[THETA, LOAD_THETA]] = position
    state[[OMEGA, LOAD_OMEGA]] = velocity
    return state
