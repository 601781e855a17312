"""An experiment as a file: excitation of ``hapticd excite``, its parameters, and live settings.

    excitation: chirp
    amplitude: 0.4        # A; rad or m for shapes that move the spring's origin
    duration_s: 8
    low_hz: 5
    high_hz: 200
    settings: {spring.stiffness: 0.004}

Only the first key is required. ``settings`` apply during the experiment and are restored after it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any, Final

from hapticd.config import LIVE_KEYS, ConfigError, Problem
from hapticd.config.nearest import nearest_key, nearest_name
from hapticd.config.reading import read_text, read_yaml
from hapticd.config.text import shown
from hapticd.servo.excitation import ALL, SHAPES

SUFFIXES: Final = (".yaml", ".yml")
_UNITS: Final = {"amplitude": "A, rad or m", "duration_s": "s", "low_hz": "Hz", "high_hz": "Hz"}
_KEYS: Final = ("excitation", *_UNITS, "seed", "settings")


@dataclass(frozen=True)
class Experiment:
    """An excitation with its parameters. The daemon chooses those that are None, and checks all against its limits."""

    excitation: str
    amplitude: float | None = None
    """Peak: A, or rad or m for shapes that move the spring's origin."""
    duration_s: float | None = None
    low_hz: float | None = None
    high_hz: float | None = None
    seed: int | None = None
    settings: Mapping[str, float | int | str | bool | None] = field(default_factory=dict)
    """Dotted live key to value, during the experiment."""

    def plan(self) -> dict[str, Any]:
        """The given parameters, as keywords of :func:`hapticd.servo.excitation.build`."""
        values = {key: getattr(self, key) for key in (*_UNITS, "seed")}
        return {key: value for key, value in values.items() if value is not None}

    def describe(self, is_linear: bool = False) -> str:
        """In words."""
        text = self.excitation
        if self.amplitude is not None:
            unit = ("m" if is_linear else "rad") if SHAPES[self.excitation].moves_origin else "A"
            text += f" of {self.amplitude:g} {unit}"
        if self.low_hz is not None and self.high_hz is not None:
            text += f" from {self.low_hz:g} to {self.high_hz:g} Hz"
        if self.duration_s is not None:
            text += f" for {self.duration_s:g} s"
        changes = [f"{key} = {value}" for key, value in self.settings.items()]
        return text + (f" with {' and '.join(changes)}" if changes else "")

    def document(self) -> dict[str, Any]:
        """The content of its file."""
        settings = {"settings": dict(self.settings)} if self.settings else {}
        return {"excitation": self.excitation, **self.plan(), **settings}


def names_file(name: str) -> bool:
    """Whether the argument of ``hapticd excite`` is a file and not a shape."""
    return "/" in name or name.endswith(SUFFIXES)


def read_experiment(path: Path) -> Experiment:
    """Read an experiment file.

    Raises:
        ConfigError: with everything that is wrong in it.
    """
    data, problems = read_yaml(read_text(path, str(path)), str(path))
    if problems:
        raise ConfigError(problems)
    return experiment_of(data, str(path))


def experiment_of(data: object, source: str) -> Experiment:
    """An experiment from plain data.

    Args:
        data: the content of a file.
        source: its name in messages.

    Raises:
        ConfigError: with everything that is wrong.
    """
    if not isinstance(data, dict):
        raise ConfigError([Problem(source, "", None, "contains no experiment; write at least 'excitation: chirp'")])
    problems = list(_problems(data, source))
    if problems:
        raise ConfigError(problems)
    return Experiment(**data)


def _problems(data: dict[str, Any], file: str) -> Iterator[Problem]:
    for key in data:
        if key not in _KEYS:
            nearest = nearest_name(key, _KEYS)
            hint = f"did you mean {nearest}?" if nearest else f"keys: {', '.join(_KEYS)}"
            yield Problem(file, key, None, f"unknown key; {hint}", nearest=nearest)
    names = (*SHAPES, ALL)
    if data.get("excitation") not in names:
        value = data.get("excitation")
        nearest = nearest_name(str(value), names)
        hint = f"did you mean {nearest}? " if nearest else ""
        yield Problem(
            file, "excitation", shown(value), f"{hint}must be one of {', '.join(names)}", names, nearest=nearest
        )
    for key, unit in _UNITS.items():
        value = data.get(key)
        if value is not None and not (_is_number(value) and isfinite(value) and value > 0):
            yield Problem(file, key, shown(value), f"must be a number above 0 {unit}", 0.0, unit)
    seed = data.get("seed")
    if seed is not None and not (isinstance(seed, int) and not isinstance(seed, bool) and seed >= 0):
        yield Problem(file, "seed", shown(seed), "must be a whole number, 0 or above", 0.0)
    yield from setting_problems(data.get("settings", {}), file)


def setting_problems(settings: object, file: str) -> Iterator[Problem]:
    """Problems of the settings of an experiment."""
    if not isinstance(settings, dict):
        yield Problem(file, "settings", shown(settings), "must be a mapping of dotted keys, {} for none")
        return
    for key, value in settings.items():
        if key not in LIVE_KEYS:
            nearest = nearest_key(key, LIVE_KEYS)
            hint = f"; did you mean {nearest}?" if nearest else ""
            message = f"not a setting that can change while the daemon runs{hint}"
            yield Problem(file, f"settings.{key}", None, message, nearest=nearest)
        elif isinstance(value, dict | list):
            yield Problem(file, f"settings.{key}", shown(value), "must be one value")


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
