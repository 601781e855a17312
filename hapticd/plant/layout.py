"""One device as a flat float64 vector: the base model's parameters, then those of every effect.

An effect that a device does not have is in the vector with its neutral value, which switches its term off. A list parameter
has one element per entry: ``torque_ripple.amplitudes[2]``.

The kernels contain the terms of hapticd's effects, and find their parameters by index. The others (`Effect.force`,
`Effect.friction`) follow in a part of fixed size, one block after another, and are called through the addresses in it, so
that no compiled code depends on the installed effects. The addresses are valid in this process only.
"""

from __future__ import annotations

import contextlib
import functools
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticd.config.problems import ConfigError, Problem
from hapticd.effects.catalogue import CATALOGUE, HOOK_HEADER, HOOK_ROOM
from hapticd.jit import effect_term_callback

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hapticd.config import Config
    from hapticd.effects.spec import Effect

BASE_NAMES = (
    "inertia",  # of the device, kg m² or kg
    "viscous",  # N m s/rad or N s/m
    "coulomb",  # N m or N
    "torque_constant",  # N m/A or N/A
    "delay_s",  # from command to current: T_A and the driver's latency
    "grip_inertia",  # config.hand: a permanent grip
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
"""Side of the backlash in contact: +1 the motor pushes the load forwards, −1 backwards, 0 none."""
MOTOR_CURRENT = 6
"""Current behind the current loop of `amplifier_lag`, A; used if commands come one by one."""
MOTOR_CURRENT_RATE = 7
"""Its derivative, A/s."""


HOOK_SIZE = 0
"""In a block of that part: its number of elements; 0 after the last block."""
HOOK_FORCE = 1
"""Address of the law of its force; 0 for none."""
HOOK_FRICTION = 2
"""Address of the law of its friction; 0 for none."""
HOOK_NEUTRAL = 3
"""Value of the first parameter at which the effect is off."""
HOOK_PARAMETERS = HOOK_HEADER
"""The first parameter."""


def _names(effect: Effect) -> list[str]:
    names = []
    for parameter in effect.parameters:
        key = f"{effect.slug}.{parameter.name}"
        names += [key] if parameter.length == 1 else [f"{key}[{k}]" for k in range(parameter.length)]
    return names


def _all_names() -> tuple[tuple[str, ...], int]:
    """Name of every element, and the index of the first hook."""
    names = list(BASE_NAMES)
    for effect in CATALOGUE.values():
        if not effect.is_hooked:
            names += _names(effect)
    first = len(names)
    for effect in CATALOGUE.values():
        if effect.is_hooked:
            header = ("size", "force", "friction", "neutral")
            names += [*(f"{effect.slug}:{name}" for name in header), *_names(effect)]
    # The size 0 marks the end of the blocks, so the catalogue leaves one element free.
    spare = first + HOOK_ROOM - len(names)
    return (*names, *(f"spare[{k}]" for k in range(spare))), first


NAMES, HOOKS = _all_names()
"""Name of every element, in order; the first one of the effects whose terms are called through a pointer."""
_INDEX = {name: index for index, name in enumerate(NAMES)}
SIZE = len(NAMES)
"""Elements of a device vector."""


def index_of(name: str) -> int:
    """Index of an element: ``inertia``, ``gravity.theta_0``, ``torque_ripple.orders[0]`` (a list's bare name is its first).

    Raises:
        KeyError: there is no such element.
    """
    return _INDEX[name] if name in _INDEX else _INDEX[f"{name}[0]"]


@functools.cache
def _callback(slug: str, hook: str) -> Any:
    """The compiled term, cached until the process ends, because vectors contain its address."""
    effect = CATALOGUE[slug]
    return effect_term_callback(getattr(effect, hook), {"force": 4, "friction": 3}[hook], effect.size)


def _addresses(effect: Effect) -> tuple[int, int]:
    """Addresses of an effect's force and friction, 0 for none."""
    force = _callback(effect.slug, "force").address if effect.force else 0
    return force, _callback(effect.slug, "friction").address if effect.friction else 0


@functools.cache
def _neutral() -> NDArray[np.float64]:
    p = np.zeros(SIZE)
    for slug, effect in CATALOGUE.items():
        for parameter in effect.parameters:
            first = index_of(f"{slug}.{parameter.name}")
            p[first : first + parameter.length] = parameter.neutral
        if effect.is_hooked:
            block = index_of(f"{slug}:size")
            p[block + HOOK_SIZE] = HOOK_PARAMETERS + effect.size
            p[block + HOOK_NEUTRAL] = effect.parameters[0].neutral
            # A device without this effect must still work if it cannot be compiled. An address has fewer than 53 bits:
            # a double represents it exactly.
            with contextlib.suppress(Exception):
                p[block + HOOK_FORCE : block + HOOK_FRICTION + 1] = _addresses(effect)
    return p


def neutral_vector() -> NDArray[np.float64]:
    """A vector of shape (SIZE,) with zeros for the base and every effect off."""
    return _neutral().copy()


def effect_values(p: NDArray[np.float64], effect: Effect) -> dict[str, Any]:
    """All parameters of an effect in a device vector: numbers, and tuples of full length."""
    values: dict[str, Any] = {}
    for parameter in effect.parameters:
        first = index_of(f"{effect.slug}.{parameter.name}")
        numbers = p[first : first + parameter.length].tolist()
        values[parameter.name] = numbers[0] if parameter.length == 1 else tuple(numbers)
    return values


def device_vector(config: Config, latency_s: float = 0.0) -> NDArray[np.float64]:
    """The vector of a config's plant with its effects, amplifier and hand.

    Args:
        config: resolved configuration.
        latency_s: sample-to-current latency of the driver, added to the amplifier's T_A.

    Returns:
        Shape (SIZE,), float64.

    Raises:
        ConfigError: it lists an effect of another package whose law cannot be compiled.
    """
    p = neutral_vector()
    p[index_of("inertia")] = config.plant.inertia
    p[index_of("viscous")] = config.plant.viscous
    p[index_of("coulomb")] = config.plant.coulomb
    p[index_of("torque_constant")] = config.amplifier.torque_constant
    p[index_of("delay_s")] = config.amplifier.delay + latency_s
    p[index_of("grip_inertia")] = config.hand.inertia
    p[index_of("grip_damping")] = config.hand.damping
    p[index_of("grip_stiffness")] = config.hand.stiffness
    p[index_of("grip_rest")] = config.origin_counts * config.raw_resolution
    for index, effect in enumerate(config.plant.effects):
        if CATALOGUE[effect.name].is_hooked:
            _check_terms(index, CATALOGUE[effect.name])
        for name, value in (effect.model_extra or {}).items():
            values = np.atleast_1d(np.asarray(value, dtype=np.float64))
            first = index_of(f"{effect.name}.{name}")
            p[first : first + len(values)] = values
    return p


def _check_terms(index: int, effect: Effect) -> None:
    try:
        _addresses(effect)
    except Exception as error:
        message = f"its law cannot be compiled: {error}"
        raise ConfigError([Problem("config", f"plant.effects[{index}].name", effect.slug, message)]) from error


def initial_state(position: float = 0.0, velocity: float = 0.0) -> NDArray[np.float64]:
    """A mechanical state of shape (STATE,): load at the shaft's position, bristle relaxed, play centred."""
    state = np.zeros(STATE)
    state[[THETA, LOAD_THETA]] = position
    state[[OMEGA, LOAD_OMEGA]] = velocity
    return state
