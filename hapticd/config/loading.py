"""From a YAML file, a preset, plain data or single settings to a validated configuration.

All of them use :func:`parse_config`, which reports all problems at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from hapticd.config._quantities import with_units
from hapticd.config._version import take_version
from hapticd.config.explain import explain, unknown_key
from hapticd.config.keys import leaf_fields, section_models
from hapticd.config.model import Config, gives_linear_encoder
from hapticd.config.nearest import nearest_name
from hapticd.config.presets import PRESETS, preset_names
from hapticd.config.problems import ConfigError, Problem
from hapticd.config.reading import read_text, read_yaml
from hapticd.config.text import shown

_OTHER_KIND = (
    "a setting cannot change a rotary device to a linear one or back; other numbers would keep their old units"
)
_EMPTY = "is empty; write {} for the built-in defaults"

ConfigSource = Config | Mapping[str, Any] | str | PathLike[str] | None
"""A configuration, plain data, a file's path or a preset's name; None for re35."""


def load_config(source: str | Path | None = None) -> Config:
    """Load a configuration.

    Args:
        source: a file's path, the name of a preset, or None for the built-in RE35 testbed. A :class:`~pathlib.Path`, or a
            string with a slash or a suffix, is always a file.

    Raises:
            ConfigError: with all problems.
    """
    if source is None:
        return parse_config({}, "built-in re35")
    if isinstance(source, str) and source in preset_names():
        return parse_yaml(read_text(PRESETS / f"{source}.yaml", source), f"preset {source}")
    path = Path(source)
    if isinstance(source, str) and path.name == source and not path.suffix and not _is_there(path):
        nearest = nearest_name(source, preset_names())
        hint = f"did you mean {nearest}?" if nearest else "presets: " + ", ".join(preset_names())
        message = f"no such file, and no preset of that name; {hint}"
        raise ConfigError([Problem(source or "''", "", None, message, preset_names(), nearest=nearest)])
    return parse_yaml(read_text(path, str(source)), str(source))


def config_of(source: ConfigSource = None, settings: Mapping[str, Any] | None = None) -> Config:
    """Resolve a configuration.

    Args:
        source: a `Config`; nested mappings as in a YAML file; a file's path; the name of a preset; None for re35.
        settings: dotted key to value, applied to it, e.g. ``{"spring.stiffness": 0.02}``.

    Raises:
            ConfigError: with all problems.
    """
    if isinstance(source, Config):
        config = source
    elif isinstance(source, Mapping):
        config = parse_config(source, "the given config")
    else:
        config = load_config(source if source is None or isinstance(source, str) else Path(source))
    return apply_settings(config, settings, source="settings") if settings else config


def _is_there(path: Path) -> bool:
    try:
        return bool(path.name) and path.exists()
    except OSError:  # a name that is too long for a file
        return False


def parse_yaml(text: str, source_name: str) -> Config:
    """Parse and validate the text of a YAML configuration.

    Raises:
        ConfigError: with everything that is wrong.
    """
    data, problems = read_yaml(text, source_name)
    if data is None and not problems:
        raise ConfigError([Problem(source_name, "", None, _EMPTY)])
    if problems:
        reported = {problem.key for problem in problems}
        others = [other for other in _validate(data, source_name)[1] if other.key not in reported]
        raise ConfigError([*problems, *others])
    return parse_config(data, source_name)


def parse_config(mapping: object, source_name: str) -> Config:
    """Validate a configuration given as plain data (nested mappings).

    Args:
        mapping: section name to mapping of keys; every key is optional.
        source_name: its name in messages.

    Raises:
            ConfigError: with all problems.
    """
    config, problems = _validate(mapping, source_name)
    if config is None or problems:
        raise ConfigError(problems)
    return config


def apply_settings(config: Config, settings: Mapping[str, object], source: str = "command line") -> Config:
    """A copy of a configuration with some dotted keys changed, validated as a whole.

    Args:
        config: configuration to start from; unchanged.
        settings: dotted key to value; text is read as a YAML value ("500", "1e-3", "true", "null").
        source: name of the settings in messages.

    Raises:
            ConfigError: an unknown key, or a value that is invalid alone or with other values.
    """
    data = config.model_dump(exclude_unset=True) | {"driver": config.driver.model_dump()}  # unset keys stay unset
    problems: list[Problem] = []
    for key, text in settings.items():
        if (refused := _unsettable(key, source)) is not None:
            problems.append(refused)
            continue
        try:
            value, doubts = read_yaml(text, source) if isinstance(text, str) else (text, [])
        except ConfigError as error:
            doubts = error.problems
        if doubts:
            problems.append(Problem(source, key, shown(text), "is not a YAML value"))
            continue
        _set(data, key, value)
    changed, wrong = _validate(data, source)
    if changed is not None and changed.is_linear != config.is_linear:
        problems.append(Problem(source, "encoder", None, _OTHER_KIND))
    if changed is None or problems or wrong:
        raise ConfigError([*problems, *wrong])
    return changed


def _unsettable(key: str, source: str) -> Problem | None:
    if key in leaf_fields() or (key.startswith("driver.") and all(key.split("."))):
        return None
    if key in section_models():
        first = next(leaf for leaf in leaf_fields() if leaf.startswith(f"{key}."))
        return Problem(source, key, None, f"is a section; set one of its keys, such as {first}", nearest=first)
    return unknown_key(key, source)


def _set(data: dict[str, Any], key: str, value: object) -> None:
    *sections, leaf = key.split(".")
    for section in sections:
        inner = data.get(section)
        data[section] = dict(inner) if isinstance(inner, Mapping) else {}
        data = data[section]
    data[leaf] = value


def _validate(mapping: object, source_name: str) -> tuple[Config | None, list[Problem]]:
    """Validate, remove invalid values, and validate again, so that checks between keys are also reported."""
    data = _plain(mapping)
    linear = isinstance(data, dict) and gives_linear_encoder(data)
    problems: list[Problem] = []
    if isinstance(data, dict):
        problems = [*take_version(data, source_name), *with_units(data, source_name, linear)]
    told = frozenset(problem.key for problem in problems)
    wrong = set(told)
    while True:
        try:
            return Config.model_validate(data), problems
        except ValidationError as error:
            found = explain(error, source_name, linear)
            locations = {details["loc"] for details in error.errors(include_url=False)}
        problems += [
            problem for problem, involves in found if problem.key not in told and not _any_within(involves, wrong)
        ]
        wrong |= {problem.key for problem, _ in found} | {problem.nearest for problem, _ in found if problem.nearest}
        if () in locations:  # checks between sections come last, so there are no further problems
            return None, problems
        for location in locations:
            _remove(data, location)


def _any_within(keys: frozenset[str], wrong: set[str]) -> bool:
    return any(key == other or key.startswith(f"{other}.") for key in keys for other in wrong)


def _plain(value: object) -> Any:
    """A copy of nested mappings and lists, from which invalid values can be removed."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def _remove(data: dict[str, Any], location: tuple[int | str, ...]) -> None:
    *sections, leaf = [str(part) for part in location]
    for section in sections:
        data = data[section]
    del data[leaf]
