"""The configuration: schema with units and limits, loading, error texts, presets.

See ``docs/reference/config.md`` for every key. Nothing here imports the compiled code.
"""

from hapticd.config._host import Api, Driver, Record
from hapticd.config._writing import config_digest, config_schema, config_to_yaml
from hapticd.config.effects import Effect
from hapticd.config.keys import LIVE_KEYS, unit_of
from hapticd.config.loading import apply_settings, load_config, parse_config, parse_yaml
from hapticd.config.model import Config
from hapticd.config.presets import preset_names
from hapticd.config.problems import ConfigError, Problem
from hapticd.config.sections import (
    Amplifier,
    Delay,
    Dither,
    Encoder,
    Hand,
    Overrun,
    Plant,
    Safety,
    Servo,
    Spring,
)
from hapticd.effects.catalogue import EFFECT_SLUGS

__all__ = [
    "EFFECT_SLUGS",
    "LIVE_KEYS",
    "Amplifier",
    "Api",
    "Config",
    "ConfigError",
    "Delay",
    "Dither",
    "Driver",
    "Effect",
    "Encoder",
    "Hand",
    "Overrun",
    "Plant",
    "Problem",
    "Record",
    "Safety",
    "Servo",
    "Spring",
    "apply_settings",
    "config_digest",
    "config_schema",
    "config_to_yaml",
    "load_config",
    "parse_config",
    "parse_yaml",
    "preset_names",
    "unit_of",
]
