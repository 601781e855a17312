"""Questions about data-sheet values and limits, which cannot be measured. The answers become a config.

An answer is a number in the given unit, or a number with another unit of the same quantity, such as g cm², mN m/A or lines.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from hapticd.config import Config, ConfigError, Problem, apply_settings, parse_config, parse_yaml, unit_of
from hapticd.config.keys import leaf_fields
from hapticd.config.nearest import nearest_name
from hapticd.config.reading import read_text, read_yaml
from hapticd.config.text import shown, yaml_value
from hapticd.config.units import UnitError, in_unit
from hapticd.identify.plausible import implausible

if TYPE_CHECKING:
    from pathlib import Path

Answers = dict[str, Any]

_UNITS: Final[Mapping[str, tuple[str, ...]]] = {
    "counts/rev": ("counts/rev", "counts", "cpr", "lines", "ppr"),
    "counts/m": ("counts/m", "counts/mm"),
    "N m/A": ("N m/A", "mN m/A", "µN m/A", "N cm/A", "oz in/A"),
    "N/A": ("N/A", "mN/A"),
    "kg m²": ("kg m²", "g cm²", "kg cm²", "g mm²", "oz in s²"),
    "kg": ("kg", "g"),
    "N m": ("N m", "mN m", "µN m", "N cm", "oz in"),
    "N": ("N", "mN"),
    "A": ("A", "mA"),
    "bits": ("bits", "bit"),
    "Hz": ("Hz", "kHz"),
    "N m/rad": ("N m/rad", "mN m/rad", "N m/deg", "mN m/deg"),
    "N/m": ("N/m", "N/mm", "kN/m"),
    "rad": ("rad", "deg", "°", "rev"),
    "m": ("m", "mm", "cm"),
    "rad/s": ("rad/s", "rpm", "deg/s"),
    "m/s": ("m/s", "mm/s"),
}
"""Units that are suggested, by the unit of the schema; every unit of the same quantity is accepted."""


@dataclass(frozen=True)
class Question:
    """One question; its unit is the schema's.

    Attributes:
        key: name of the answer. text: of the question.
        place: dotted key of the config that gets the answer.
        kind: ``rotary`` or ``linear`` if the question is for such a device only. driver: likewise, for a driver.
        own_default: default; None: the schema's default, which is for a rotary device.
        choices: the possible answers, if they are words.
    """

    key: str
    text: str
    place: str = ""
    kind: str = ""
    own_default: Any = None
    choices: tuple[str, ...] = ()
    driver: str = ""

    @property
    def default(self) -> Any:
        """The value if there is no answer."""
        return leaf_fields()[self.place].default if self.own_default is None else self.own_default

    @property
    def unit(self) -> str:
        """Unit of a plain number; empty for a word."""
        return unit_of(self.place, self.kind == "linear")

    @property
    def units(self) -> tuple[str, ...]:
        """Units that are suggested."""
        return _UNITS.get(self.unit, ())

    def applies(self, answers: Mapping[str, Any]) -> bool:
        """Whether the question applies, given other answers."""
        fits = not self.kind or answers.get("device") == self.kind
        return fits and (not self.driver or answers.get("driver") == self.driver)

    @property
    def shown_default(self) -> str:
        """The default as text."""
        return f"{self.default:g}" if isinstance(self.default, float) else str(self.default)

    @property
    def prompt(self) -> str:
        """The question with its unit or choices."""
        inside = ", ".join(self.choices) or self.unit
        return f"{self.text} ({inside})" if inside else self.text

    @property
    def line(self) -> str:
        """Its line in the list of questions."""
        only = f", {self.kind or self.driver} only" if self.kind or self.driver else ""
        return f"{self.key:<20} {self.prompt} [{self.shown_default}]{only}"

    @property
    def document(self) -> dict[str, Any]:
        """The question as data."""
        return {
            "key": self.key,
            "text": self.text,
            "unit": self.unit,
            "units": list(self.units),
            "choices": list(self.choices),
            "default": self.default,
            "only": self.kind or self.driver or None,
        }


QUESTIONS: Final[tuple[Question, ...]] = (
    Question(
        "device", "What moves: an axis that turns, or a slide", own_default="rotary", choices=("rotary", "linear")
    ),
    Question(
        "driver",
        "How hapticd reaches it; loopback is simulated",
        "driver.name",
        choices=("loopback", "serial_dac", "canopen"),
    ),
    Question(
        "port",
        "Port of the board, as /dev/serial/by-id/... has it",
        "driver.port",
        driver="serial_dac",
        own_default="/dev/ttyUSB0",
    ),
    Question("channel", "CAN interface", "driver.channel", driver="canopen", own_default="can0"),
    Question("node_id", "Number of the drive's node", "driver.node_id", driver="canopen", own_default=1),
    Question(
        "counts_per_rev", "Encoder: counts per revolution, four times its lines", "encoder.counts_per_rev", "rotary"
    ),
    Question("counts_per_metre", "Encoder: counts per metre", "encoder.counts_per_metre", "linear", 100000.0),
    Question("torque_constant", "Motor: torque constant, from its data sheet", "amplifier.torque_constant", "rotary"),
    Question(
        "force_constant", "Motor: force constant, from its data sheet", "amplifier.torque_constant", "linear", 10.0
    ),
    Question("inertia", "Inertia of rotor and load, a guess will do", "plant.inertia", "rotary"),
    Question("mass", "Moving mass, a guess will do", "plant.inertia", "linear", 0.1),
    Question("friction_torque", "Torque that just moves it, a guess will do", "plant.coulomb", "rotary"),
    Question("friction_force", "Force that just moves it, a guess will do", "plant.coulomb", "linear", 0.5),
    Question(
        "continuous_current",
        "Current that may flow for ever: the lower one of motor and amplifier",
        "amplifier.continuous_current",
    ),
    Question("peak_current", "Largest current for a second", "amplifier.peak_current"),
    Question("full_scale_current", "Current at full scale of the command", "amplifier.dac_full_scale"),
    Question("dac_bits", "Bits of the command over plus and minus full scale; 0: not quantised", "amplifier.dac_bits"),
    Question(
        "bandwidth",
        "Bandwidth of the amplifier's current loop; 0: not known, taken as ideal",
        "amplifier.bandwidth_hz",
    ),
    Question("rate", "Servo rate", "servo.rate_hz"),
    Question("stiffness", "Virtual spring", "spring.stiffness", "rotary"),
    Question("linear_stiffness", "Virtual spring", "spring.stiffness", "linear", 10.0),
    Question("max_excursion", "How far it may go from the spring's origin", "safety.max_excursion", "rotary"),
    Question("max_travel", "How far it may go from the spring's origin", "safety.max_excursion", "linear", 0.2),
    Question("max_speed", "How fast it may become", "safety.max_velocity", "rotary"),
    Question("max_linear_speed", "How fast it may become", "safety.max_velocity", "linear", 2.0),
)
_BY_KEY: Final = {question.key: question for question in QUESTIONS}
"""Digits of an answer in SI units: the product with a unit's factor has more digits than the answer."""


def read_answers(path: Path) -> Answers:
    """Answers from a YAML file, not yet checked.

    Raises:
        ConfigError: it cannot be read, or is not a mapping.
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
        ConfigError: an unknown key or an invalid answer; all problems at once.
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
                if question.driver:
                    message = f"is for driver {question.driver}, and driver is {found['driver']}"
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
    if isinstance(question.default, str):
        if not isinstance(said, str) or not said.strip():
            raise ValueError("must be text")
        return said.strip()
    if isinstance(said, bool) or not isinstance(said, int | float | str):
        raise ValueError(f"must be a number in {question.unit}")
    try:
        value = in_unit(str(said), question.unit)
    except UnitError as error:
        raise ValueError(f"{error.about}; known: {', '.join(question.units)}") from None
    if isinstance(question.default, int):
        if not value.is_integer():
            raise ValueError("must be a whole number")
        return int(value)
    return value


def doubt_about(question: Question, value: Any) -> str:
    """Why an answer is implausible; empty if it is not."""
    if not question.kind or question.place.partition(".")[0] not in ("plant", "amplifier", "encoder"):
        return ""
    device = parse_config({"encoder": {"counts_per_metre": 1e5}} if question.kind == "linear" else {}, "answer")
    said = implausible(apply_settings(device, {question.place: value}, source="answer"))
    return next((words for words in said if words.startswith(f"{question.place} ")), "")


def config_text(answers: Mapping[str, Any], said: Container[str] | None = None) -> tuple[str, Config, list[str]]:
    """A config from answers.

    Args:
        answers: from `answered`. said: keys that were answered; plant values without an answer are omitted. None: all.

    Returns:
        Its text, the config, and warnings about implausible values.

    Raises:
        ConfigError: answers contradict each other, or a limit of the schema.
    """
    sections: dict[str, dict[str, tuple[Any, str]]] = {}
    for question in QUESTIONS:
        guessed = question.place.startswith("plant.") and said is not None and question.key not in said
        if guessed and question.own_default is None:
            continue
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
