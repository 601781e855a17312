"""What no measurement tells and a person must say: data-sheet values and limits. Answers become a config.

An answer is a number in the unit asked for, or a number with another unit of the same kind: data sheets print g cm², mN m/A
and lines.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING, Any, Final

from hapticd.config import Config, ConfigError, Problem, parse_yaml
from hapticd.config.nearest import nearest_name
from hapticd.config.reading import read_text, read_yaml
from hapticd.config.text import shown, yaml_value
from hapticd.identify.plausible import implausible

if TYPE_CHECKING:
    from pathlib import Path

Answers = dict[str, Any]

_TORQUE: Final = {"N m": 1.0, "mN m": 1e-3, "µN m": 1e-6, "N cm": 1e-2, "oz in": 7.0615518e-3}
_CURRENT: Final = {"A": 1.0, "mA": 1e-3}
_INERTIA: Final = {"kg m²": 1.0, "g cm²": 1e-7, "kg cm²": 1e-4, "g mm²": 1e-9, "oz in s²": 7.0615518e-3}
_HERTZ: Final = {"Hz": 1.0, "kHz": 1e3}
_ANGLE: Final = {"rad": 1.0, "deg": pi / 180.0, "°": pi / 180.0, "rev": 2.0 * pi}
_SPEED: Final = {"rad/s": 1.0, "rpm": 2.0 * pi / 60.0, "deg/s": pi / 180.0}
_STIFFNESS: Final = {"N m/rad": 1.0, "mN m/rad": 1e-3, "N m/deg": 180.0 / pi, "mN m/deg": 0.18 / pi}
_LENGTH: Final = {"m": 1.0, "mm": 1e-3, "cm": 1e-2}
_LINEAR_SPEED: Final = {"m/s": 1.0, "mm/s": 1e-3}
_LINEAR_STIFFNESS: Final = {"N/m": 1.0, "N/mm": 1e3, "kN/m": 1e3}


@dataclass(frozen=True)
class Question:
    """One thing to ask.

    Attributes:
        key: name of the answer. text: what is asked. unit: of a plain number; empty for a word or a count.
        units: other units, lower case, and their factors. default: taken where nothing is said.
        choices: words, where it is none of the numbers.
        kind: ``rotary`` or ``linear`` for a question that only such a device has.
        place: dotted key of the config that takes the answer.
    """

    key: str
    text: str
    default: Any
    unit: str = ""
    units: Mapping[str, float] | None = None
    choices: tuple[str, ...] = ()
    kind: str = ""
    place: str = ""

    def applies(self, answers: Mapping[str, Any]) -> bool:
        """Whether it is to be asked at all."""
        return not self.kind or answers.get("device") == self.kind

    @property
    def shown_default(self) -> str:
        """The default as text."""
        return f"{self.default:g}" if isinstance(self.default, float) else str(self.default)

    @property
    def prompt(self) -> str:
        """The question with unit or choices."""
        inside = ", ".join(self.choices) or self.unit
        return f"{self.text} ({inside})" if inside else self.text

    @property
    def line(self) -> str:
        """One line of the list."""
        only = f", {self.kind} only" if self.kind else ""
        return f"{self.key:<20} {self.prompt} [{self.shown_default}]{only}"

    @property
    def document(self) -> dict[str, Any]:
        """The question as data."""
        return {
            "key": self.key,
            "text": self.text,
            "unit": self.unit,
            "units": list(self.units or ()),
            "choices": list(self.choices),
            "default": self.default,
            "only": self.kind or None,
        }


QUESTIONS: Final[tuple[Question, ...]] = (
    Question("device", "What moves: an axis that turns, or a slide", "rotary", choices=("rotary", "linear")),
    Question(
        "driver",
        "How hapticd reaches it; loopback is simulated",
        "loopback",
        choices=("loopback", "serial_dac", "canopen"),
        place="driver.name",
    ),
    Question(
        "counts_per_rev",
        "Encoder: counts per revolution, four times its lines",
        8192.0,
        "counts/rev",
        {"counts/rev": 1.0, "counts": 1.0, "cpr": 1.0, "lines": 4.0, "ppr": 4.0},
        kind="rotary",
        place="encoder.counts_per_rev",
    ),
    Question(
        "counts_per_metre",
        "Encoder: counts per metre",
        100000.0,
        "counts/m",
        {"counts/m": 1.0, "counts/mm": 1e3},
        kind="linear",
        place="encoder.counts_per_metre",
    ),
    Question(
        "torque_constant",
        "Motor: torque constant, from its data sheet",
        0.0292,
        "N m/A",
        {f"{unit}/A": factor for unit, factor in _TORQUE.items()},
        kind="rotary",
        place="amplifier.torque_constant",
    ),
    Question(
        "force_constant",
        "Motor: force constant, from its data sheet",
        10.0,
        "N/A",
        {"N/A": 1.0, "mN/A": 1e-3},
        kind="linear",
        place="amplifier.torque_constant",
    ),
    Question(
        "inertia",
        "Inertia of rotor and load, a guess will do",
        6.28e-6,
        "kg m²",
        _INERTIA,
        kind="rotary",
        place="plant.inertia",
    ),
    Question(
        "mass", "Moving mass, a guess will do", 0.1, "kg", {"kg": 1.0, "g": 1e-3}, kind="linear", place="plant.inertia"
    ),
    Question(
        "friction_torque",
        "Torque that just moves it, a guess will do",
        2e-3,
        "N m",
        _TORQUE,
        kind="rotary",
        place="plant.coulomb",
    ),
    Question(
        "friction_force",
        "Force that just moves it, a guess will do",
        0.5,
        "N",
        {"N": 1.0, "mN": 1e-3},
        kind="linear",
        place="plant.coulomb",
    ),
    Question(
        "continuous_current",
        "Current that may flow for ever: the lower one of motor and amplifier",
        2.0,
        "A",
        _CURRENT,
        place="amplifier.continuous_current",
    ),
    Question("peak_current", "Largest current for a second", 6.0, "A", _CURRENT, place="amplifier.peak_current"),
    Question(
        "full_scale_current",
        "Current at full scale of the command",
        6.0,
        "A",
        _CURRENT,
        place="amplifier.dac_full_scale",
    ),
    Question(
        "dac_bits",
        "Bits of the command over plus and minus full scale; 0: not quantised",
        14,
        "bits",
        {"bits": 1.0, "bit": 1.0},
        place="amplifier.dac_bits",
    ),
    Question(
        "bandwidth",
        "Bandwidth of the amplifier's current loop; 0: not known, taken as ideal",
        3000.0,
        "Hz",
        _HERTZ,
        place="amplifier.bandwidth_hz",
    ),
    Question("rate", "Servo rate", 1000.0, "Hz", _HERTZ, place="servo.rate_hz"),
    Question("stiffness", "Virtual spring", 0.012, "N m/rad", _STIFFNESS, kind="rotary", place="spring.stiffness"),
    Question(
        "linear_stiffness", "Virtual spring", 10.0, "N/m", _LINEAR_STIFFNESS, kind="linear", place="spring.stiffness"
    ),
    Question(
        "max_excursion",
        "How far it may go from the spring's origin",
        10.0,
        "rad",
        _ANGLE,
        kind="rotary",
        place="safety.max_excursion",
    ),
    Question(
        "max_travel",
        "How far it may go from the spring's origin",
        0.2,
        "m",
        _LENGTH,
        kind="linear",
        place="safety.max_excursion",
    ),
    Question("max_speed", "How fast it may become", 400.0, "rad/s", _SPEED, kind="rotary", place="safety.max_velocity"),
    Question(
        "max_linear_speed",
        "How fast it may become",
        2.0,
        "m/s",
        _LINEAR_SPEED,
        kind="linear",
        place="safety.max_velocity",
    ),
)
_BY_KEY: Final = {question.key: question for question in QUESTIONS}
_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)")
_DIGITS: Final = 12
"""Of an answer in SI units: the product with a unit's factor has more, which nobody said."""
_WHOLE: Final = frozenset({"dac_bits"})


def read_answers(path: Path) -> Answers:
    """Answers from a YAML file, not yet checked.

    Raises:
        ConfigError: it cannot be read, or holds no mapping.
    """
    data, problems = read_yaml(read_text(path, str(path)), str(path))
    if not problems and not isinstance(data, dict):
        problems = [Problem(str(path), "", None, "holds no answers; write lines such as 'torque_constant: 30 mN m/A'")]
    if problems:
        raise ConfigError(problems)
    assert isinstance(data, dict)
    return data


def answered(given: Mapping[str, Any], source: str) -> Answers:
    """Every question that applies, with its answer in SI units or its default.

    Raises:
        ConfigError: an unknown key, or an answer that is none, all of them at once.
    """
    problems = []
    for key in given:
        if key not in _BY_KEY:
            nearest = nearest_name(key, _BY_KEY)
            hint = f"; did you mean {nearest}?" if nearest else f"; keys: {', '.join(_BY_KEY)}"
            problems.append(Problem(source, key, None, f"is no question{hint}", nearest=nearest))
    found: Answers = {}
    for question in QUESTIONS:
        if not question.applies(found):
            if question.key in given:
                message = f"is for a {question.kind} device, and device is {found['device']}"
                problems.append(Problem(source, question.key, None, message))
            continue
        try:
            found[question.key] = _value(question, given[question.key]) if question.key in given else question.default
        except ValueError as error:
            problems.append(Problem(source, question.key, shown(given[question.key]), str(error), unit=question.unit))
            found[question.key] = question.default
    if problems:
        raise ConfigError(problems)
    return found


def _value(question: Question, said: Any) -> Any:
    if question.choices:
        if said not in question.choices:
            raise ValueError(f"must be one of {', '.join(question.choices)}")
        return said
    if isinstance(said, bool) or not isinstance(said, int | float | str):
        raise ValueError(f"must be a number in {question.unit}")
    match = _NUMBER.fullmatch(str(said))
    if match is None:
        raise ValueError(f"is not a number; write it in {question.unit}")
    unit = " ".join(match[2].replace("^2", "²").replace("·", " ").replace("*", " ").lower().split())
    units = {name.lower(): factor for name, factor in (question.units or {}).items()}
    if unit and unit not in units:
        raise ValueError(f"unit {match[2]!r} is not known here; known: {', '.join(question.units or {})}")
    value = float(f"{float(match[1]) * (units[unit] if unit else 1.0):.{_DIGITS}g}")
    if question.key in _WHOLE:
        if not value.is_integer():
            raise ValueError("must be a whole number")
        return int(value)
    return value


def doubt_about(question: Question, value: Any) -> str:
    """Why an answer on its own is hardly meant; empty where nothing is to be said."""
    section, _, name = question.place.partition(".")
    if question.kind == "" or section not in ("plant", "amplifier", "encoder"):
        return ""
    encoder = {"counts_per_metre": 1e5} if question.kind == "linear" else {"counts_per_rev": 8192.0}
    data = {"encoder": encoder, section: {**(encoder if section == "encoder" else {}), name: value}}
    text = "\n".join(f"{key}: {yaml_value(part)}" for key, part in data.items())
    said = [words for words in implausible(parse_yaml(text, "answer")) if words.startswith(f"{question.place} ")]
    return said[0] if said else ""


def config_text(answers: Mapping[str, Any]) -> tuple[str, Config, list[str]]:
    """A config from answers.

    Args:
        answers: from `answered`.

    Returns:
        Its text, itself, and what is implausible in it.

    Raises:
        ConfigError: the answers contradict each other or a limit of the schema.
    """
    sections: dict[str, dict[str, tuple[Any, str]]] = {}
    for question in QUESTIONS:
        if question.place and question.key in answers:
            section, _, name = question.place.partition(".")
            sections.setdefault(section, {})[name] = (answers[question.key], question.unit)
    lines = ["# Made by hapticd init: data-sheet values and limits. 'hapticd identify' measures the plant."]
    for section, entries in sections.items():
        lines += ["", f"{section}:"]
        for name, (value, unit) in entries.items():
            guess = "; a guess: hapticd identify measures it" if section == "plant" else ""
            lines.append(f"  {name}: {yaml_value(value)}" + (f"  # {unit}{guess}" if unit else ""))
    text = "\n".join(lines) + "\n"
    config = parse_yaml(text, "the config of these answers")
    return text, config, implausible(config)
