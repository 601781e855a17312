"""Values that a config of a real device does not give, for which those of the simulated RE35 testbed are used."""

from __future__ import annotations

from hapticd.config.keys import leaf_fields, unit_of
from hapticd.config.model import Config
from hapticd.config.text import yaml_value

_PLANT = ("plant.inertia", "plant.viscous", "plant.coulomb")
_OF_A_DEVICE = ("amplifier.torque_constant", *_PLANT)


def assumed(config: Config) -> tuple[str, ...]:
    """Dotted keys of a device that are missing in its config; none for the simulated testbed, which the defaults describe.

    A config describes another device if its driver is not loopback, or if it gives another inertia.
    """
    other = config.plant.inertia != leaf_fields()["plant.inertia"].default
    if config.driver.name == "loopback" and not other:
        return ()
    keys = _PLANT if config.driver.name == "loopback" else _OF_A_DEVICE
    places = ((key, *key.split(".")) for key in keys)
    return tuple(key for key, section, name in places if name not in getattr(config, section).model_fields_set)


def assumed_text(config: Config) -> str:
    """The assumed values in a sentence; empty if there are none."""
    keys = assumed(config)
    if not keys:
        return ""
    values = []
    for key in keys:
        section, _, name = key.partition(".")
        values.append(f"{key} = {yaml_value(getattr(getattr(config, section), name))} {unit_of(key, config.is_linear)}")
    return (
        f"assumed, because the config does not give it: {', '.join(values)}, as in the simulated testbed; nothing is proven "
        "for this device without them: 'hapticd identify --live' measures the plant, a data sheet has the torque constant"
    )
