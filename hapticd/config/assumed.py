"""What a config does not say of its own device, and what stands in its place: the simulated RE35's numbers."""

from __future__ import annotations

from hapticd.config.keys import leaf_fields, unit_of
from hapticd.config.model import Config
from hapticd.config.text import yaml_value

_PLANT = ("plant.inertia", "plant.viscous", "plant.coulomb")
_OF_A_DEVICE = ("amplifier.torque_constant", *_PLANT)


def assumed(config: Config) -> tuple[str, ...]:
    """Dotted keys that nobody said; none for the simulated testbed, whose numbers the defaults are.

    A config is of another device where its driver is another than loopback, or its plant has another inertia.
    """
    other = config.plant.inertia != leaf_fields()["plant.inertia"].default
    if config.driver.name == "loopback" and not other:
        return ()
    keys = _PLANT if config.driver.name == "loopback" else _OF_A_DEVICE
    places = ((key, *key.split(".")) for key in keys)
    return tuple(key for key, section, name in places if name not in getattr(config, section).model_fields_set)


def assumed_text(config: Config) -> str:
    """What is assumed, with values, in a sentence; empty where nothing is."""
    keys = assumed(config)
    if not keys:
        return ""
    values = []
    for key in keys:
        section, _, name = key.partition(".")
        values.append(f"{key} = {yaml_value(getattr(getattr(config, section), name))} {unit_of(key, config.is_linear)}")
    return (
        f"assumed, for the config does not say it: {', '.join(values)}, the simulated testbed's; nothing is proven of this "
        "device until they are said: 'hapticd identify --live' measures the plant, a data sheet has the torque constant"
    )
