"""A sequence as a file: a list of settings, with one release each (`hapticd sequence FILE`).

    name: stiffness
    deflection: 20.3          # coarse ticks of each step's own settings, or text with a unit: 30deg
    duration_s: 2
    repeat: 3                 # of the whole list
    steps:
      - {spring.stiffness: 0.008}
      - {spring.stiffness: 0.012, deflection: 10.3}

Only ``steps`` is required; a step may have its own ``deflection`` and ``duration_s``.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any, Final

from ruamel.yaml import YAML

from hapticd.config import Config, ConfigError, Problem, apply_settings
from hapticd.config.nearest import nearest_name
from hapticd.config.reading import read_yaml
from hapticd.config.text import shown
from hapticd.config.units import deflection_ticks, seconds, split
from hapticd.servo.experiment import setting_problems

DEFLECTION: Final = 10.3
"""Default, coarse ticks."""
MOST_STEPS: Final = 500
_WIDTH: Final = 200
_OWN: Final = ("deflection", "duration_s")
_KEYS: Final = ("name", *_OWN, "repeat", "steps")


@dataclass(frozen=True)
class Sequence:
    """The content of a sequence file.

    Attributes:
        name: of the experiment.
        steps: each with settings, ``deflection`` (a number of ticks, or text with a unit) and ``duration_s`` (or None).
    """

    name: str
    steps: tuple[tuple[Mapping[str, Any], float | str, float | None], ...]

    def request(self, config: Config) -> dict[str, Any]:
        """The fields of `Endpoints.sequence`, with deflections in ticks.

        Args:
            config: the daemon's present config.

        Raises:
            ConfigError: a setting is wrong. UnitError: a deflection has a unit that this device cannot have.
        """
        steps = []
        for number, (settings, deflection, lasting_s) in enumerate(self.steps, 1):
            its_own = apply_settings(config, settings, source=f"step {number}")
            step = {"deflection": deflection_ticks(deflection, its_own), "settings": dict(settings)}
            steps.append(step if lasting_s is None else {**step, "duration_s": lasting_s})
        return {"steps": steps, "name": self.name}


def read_sequence(text: str, source: str) -> Sequence:
    """Read a sequence.

    Args:
        text: of the file. source: its name in messages.

    Raises:
        ConfigError: with everything that is wrong in it.
    """
    data, problems = read_yaml(text, source)
    data = {"steps": data} if isinstance(data, list) else data
    if not problems and not isinstance(data, dict):
        problems = [Problem(source, "", None, "contains no sequence; write at least 'steps:' with one step below it")]
    if problems or not isinstance(data, dict):
        raise ConfigError(problems)
    if problems := list(_problems(data, source)):
        raise ConfigError(problems)
    steps = [
        (
            {key: value for key, value in step.items() if key not in _OWN},
            step.get("deflection", data.get("deflection", DEFLECTION)),
            _seconds(step.get("duration_s", data.get("duration_s"))),
        )
        for step in data["steps"]
    ]
    return Sequence(str(data.get("name", "sequence")), tuple(steps * data.get("repeat", 1)))


def changed_step(text: str, number: int, key: str, value: float | str) -> str:
    """A sequence's text with one key of a step changed; comments and everything else are unchanged.

    Args:
        text: a valid sequence. number: of the step in the order of execution, with repetitions, from 1.
    """
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = _WIDTH
    yaml.indent(mapping=2, sequence=4, offset=2)
    data = yaml.load(text)
    steps = data if isinstance(data, list) else data["steps"]
    steps[(number - 1) % len(steps)][key] = value
    written = io.StringIO()
    yaml.dump(data, written)
    return written.getvalue()


def _problems(data: dict[str, Any], file: str) -> Iterator[Problem]:
    for key in data:
        if key not in _KEYS:
            nearest = nearest_name(str(key), _KEYS)
            hint = f"did you mean {nearest}?" if nearest else f"keys: {', '.join(_KEYS)}"
            yield Problem(file, str(key), None, f"unknown key; {hint}", nearest=nearest)
    name, repeat, steps = data.get("name", "sequence"), data.get("repeat", 1), data.get("steps")
    if not isinstance(name, str) or not 1 <= len(name) <= 200:
        yield Problem(file, "name", shown(name), "must be text of 1 to 200 characters", 200)
    yield from _own_problems(data, file, "")
    if not isinstance(steps, list) or not steps or not all(isinstance(step, dict) for step in steps):
        yield Problem(file, "steps", None, "must be a list of steps, each a mapping of dotted keys; {} changes nothing")
        return
    if isinstance(repeat, bool) or not isinstance(repeat, int) or not 1 <= repeat * len(steps) <= MOST_STEPS:
        yield Problem(
            file, "repeat", shown(repeat), f"must be a whole number with at most {MOST_STEPS} steps in all", MOST_STEPS
        )
    for number, step in enumerate(steps, 1):
        yield from _own_problems(step, file, f"steps.{number}.")
        settings = {key: value for key, value in step.items() if key not in _OWN}
        for problem in setting_problems(settings, file):
            yield Problem(
                file, f"steps.{number}.{problem.key.removeprefix('settings.')}", problem.value, problem.message
            )


def _own_problems(data: Mapping[str, Any], file: str, prefix: str) -> Iterator[Problem]:
    for key, read in (("deflection", _deflection), ("duration_s", _seconds)):
        try:
            read(data.get(key))
        except ValueError as error:
            yield Problem(file, prefix + key, shown(data[key]), str(error))


def _deflection(said: Any) -> None:
    """Check its form; whether its unit is possible depends on the device's config.

    Raises:
        ValueError: it is neither a number nor a quantity.
    """
    if isinstance(said, str):
        split(said)
    elif said is not None and not _is_number(said):
        raise ValueError("must be a number of ticks, or text with a unit")


def _seconds(said: Any) -> float | None:
    """A duration, s; None if not given.

    Raises:
        ValueError: it is not a duration.
    """
    if said is None:
        return None
    found = seconds(said) if isinstance(said, str) else said
    if not _is_number(found) or not found > 0.0:
        raise ValueError("must be above 0 s")
    return float(found)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
