"""The map of an import: which column of a foreign file is what, in which unit. Keys: docs/reference/import-map.md."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, StrictBool, StrictInt, StrictStr, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from hapticd.config.explain import key_path
from hapticd.config.fields import Number, quantity
from hapticd.config.nearest import nearest_key
from hapticd.config.problems import ConfigError, Problem
from hapticd.config.reading import read_text, read_yaml
from hapticd.config.text import shown
from hapticd.config.units import (
    ANGLE_UNITS,
    CURRENT_UNITS,
    FORCE_UNITS,
    LENGTH_UNITS,
    TIME_UNITS,
    TORQUE_UNITS,
    spelled,
)

COUNT = "count"


def _reference(column: object) -> object:
    if isinstance(column, bool) or not isinstance(column, str | int):
        raise PydanticCustomError("no_column", "must be a column's name or its number from 0")
    return column


Reference = Annotated[str | int, BeforeValidator(_reference)]


def _spelled(unit: object) -> object:
    own = spelled(unit) if isinstance(unit, str) else unit
    return COUNT if own == "counts" else own


Unit = Annotated[StrictStr, BeforeValidator(_spelled)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Signal(_Part):
    """One column and how it becomes a quantity: (column · factor + offset) · sign, in ``unit``."""

    column: Reference = quantity(
        ..., "Column: name, number from 0, or place in a .mat or .npz (a.b, Y(2).Data, q(:,3), q[:,2])"
    )
    unit: Unit | None = quantity(None, "Unit of the column after factor and offset; null: SI")
    factor: Number = quantity(1.0, "Number the column is multiplied by, before the unit")
    offset: Number = quantity(0.0, "Number added after the factor, before the unit")
    sign: Literal[1, -1] = quantity(1, "-1 where the file counts the other way round")


class Time(_Part):
    """Time stamps: a column, or a rate for a file without one."""

    column: Reference | None = quantity(None, "Column of the time stamps")
    unit: Unit = quantity("s", "Unit of the time stamps: " + ", ".join(TIME_UNITS))
    wrap: Number | None = quantity(
        None,
        "Range after which the stamps start again (4294967296 of micros()), in their unit: they are carried on",
        gt=0,
    )
    rate_hz: Number | None = quantity(None, "Sampling rate of a file without time stamps", "Hz", gt=0)


class Position(Signal):
    """Position of the device: encoder counts, or an angle or length with its resolution."""

    resolution: Number | None = quantity(
        None, "Width of one step of the position, in its unit, where it is not one encoder count", gt=0
    )
    wrap: Number | None = quantity(
        None, "Range after which the position starts again (65536 counts, 360 deg), in its unit: it is unwrapped", gt=0
    )


class Encoder(_Part):
    """The encoder behind the position."""

    counts_per_rev: Number | None = quantity(None, "Counts per revolution of a rotary device", "counts/rev", ge=1)
    counts_per_metre: Number | None = quantity(None, "Counts per metre of a linear device", "counts/m", ge=1)


class Csv(_Part):
    """How a text file is written; null: as its first lines look. Lines with # before the data are passed over."""

    delimiter: StrictStr | None = quantity(None, "Character between two values; \\t for a tab, a space for any number")
    decimal: Literal[".", ","] = quantity(".", "Decimal point")
    header: StrictBool | None = quantity(
        None, "The first line holds the names of the columns; null: unless it holds numbers (names may stand behind #)"
    )
    skip_lines: StrictInt = quantity(0, "Lines to pass over before that", ge=0, le=1_000_000)


class Urdf(_Part):
    """Where the limits of the joint stand."""

    file: StrictStr = quantity(..., "URDF of the robot: its limits are held against what was recorded")
    joint: StrictStr | None = quantity(None, "Joint in it; null: the position's, or the only one that moves")


class ImportMap(_Part):
    """What the columns of a foreign file are."""

    device: Literal["rotary", "linear"] = quantity(..., "rotary: rad, N m; linear: m, N")
    time: Time = quantity(..., "Time stamps or rate")
    position: Position = quantity(..., "Position")
    current: Signal | None = quantity(None, "Commanded current; or force")
    force: Signal | None = quantity(None, "Commanded torque or force; or current")
    current_measured: Signal | None = quantity(None, "Current measured by the amplifier")
    encoder: Encoder = quantity(Encoder, "Encoder")
    torque_constant: Number | None = quantity(
        None, "Torque or force per current, with which a force is stored as a current", "N m/A", linear="N/A", gt=0
    )
    model: StrictStr | None = quantity(
        None, "Config file or preset of the device that was recorded; kept in the run, as in a native one"
    )
    urdf: Urdf | None = quantity(None, "URDF of the robot")
    variable: StrictStr | None = quantity(
        None, ".mat, .npz: variable or struct (a.b, Y(2)) in which the columns are looked up"
    )
    channels: Literal["auto", "rows", "columns"] = quantity(
        "auto", ".npy, matrix of .mat or .npz: the axis that holds the channels; auto: the shorter one"
    )
    csv: Csv = quantity(Csv, "How a .csv file is written")
    from_s: Number | None = quantity(None, "Leave out what comes before, in s from the file's first sample", "s")
    until_s: Number | None = quantity(None, "Leave out what comes after, in s from the file's first sample", "s")
    every: StrictInt = quantity(
        1, "Keep every n-th sample; the commands in between are averaged, which keeps their impulse", "samples", ge=1
    )

    @property
    def is_linear(self) -> bool:
        """Metres and newtons."""
        return self.device == "linear"

    @property
    def position_units(self) -> dict[str, float]:
        """Units a position may have, apart from counts, with their size in rad or m."""
        return LENGTH_UNITS if self.is_linear else ANGLE_UNITS

    @property
    def force_units(self) -> dict[str, float]:
        """Units a force may have, with their size in N m or N."""
        return FORCE_UNITS if self.is_linear else TORQUE_UNITS


def load_map(path: str | Path) -> ImportMap:
    """Read and check the map of an import.

    Raises:
        ConfigError: with everything that is wrong, each problem with file, key, value and the nearest valid key.
    """
    data, problems = read_yaml(read_text(Path(path), str(path)), str(path))
    if problems:
        raise ConfigError(problems)
    return parse_map(data, str(path))


def parse_map(data: object, source: str) -> ImportMap:
    """Check a map given as plain data; ``source`` is what messages call it. Raises as `load_map`."""
    if not isinstance(data, Mapping):
        raise ConfigError(
            [Problem(source, "", None, "must be a mapping, such as device: rotary and time: {column: t}")]
        )
    try:
        parsed = ImportMap.model_validate(data)
    except ValidationError as error:
        raise ConfigError([_problem(item, source) for item in error.errors(include_url=False)]) from None
    problems = list(_contradictions(parsed, source))
    if problems:
        raise ConfigError(problems)
    return parsed


def map_keys() -> list[str]:
    """Every dotted key of a map."""
    return list(_keys(ImportMap, ""))


def _keys(part: type[BaseModel], prefix: str) -> Iterable[str]:
    for name, field in part.model_fields.items():
        kinds = [field.annotation, *getattr(field.annotation, "__args__", ())]
        inner = next((kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)), None)
        if inner is None:
            yield prefix + name
        else:
            yield from _keys(inner, f"{prefix}{name}.")


def _problem(details: ErrorDetails, source: str) -> Problem:
    key, kind = key_path(details["loc"]), details["type"]
    context = details.get("ctx", {})
    if kind == "missing":
        return Problem(source, key, None, "is missing")
    if kind == "extra_forbidden":
        near = nearest_key(key, [*map_keys(), *ImportMap.model_fields])
        hint = f"; did you mean {near}?" if near else "; valid keys: " + ", ".join(map_keys())
        return Problem(source, key, None, f"unknown key{hint}", nearest=near)
    value = shown(details["input"])
    if kind in ("model_type", "model_attributes_type"):
        return Problem(source, key, value, "must be a mapping, such as {column: name}")
    comparisons = {"greater_than": ("above", "gt"), "greater_than_equal": ("at least", "ge")}
    comparisons |= {"less_than_equal": ("at most", "le")}
    if kind in comparisons:
        text, bound = comparisons[kind]
        return Problem(source, key, value, f"must be {text} {context[bound]:g}", context[bound])
    if kind == "literal_error":
        return Problem(source, key, value, f"must be {context['expected']}")
    text = str(details["msg"])
    return Problem(source, key, value, text[:1].lower() + text[1:])


def _contradictions(parsed: ImportMap, source: str) -> Iterable[Problem]:
    """What is wrong between keys, and units that do not exist."""
    if (parsed.time.column is None) == (parsed.time.rate_hz is None):
        yield Problem(source, "time", None, "needs either column (time stamps) or rate_hz")
    if (parsed.current is None) == (parsed.force is None):
        yield Problem(source, "current", None, "needs either current or force, the command that drove the device")
    if parsed.force is not None and parsed.torque_constant is None and parsed.model is None:
        message = "is missing: a force is stored as the current that makes it (or give model, which has one)"
        yield Problem(source, "torque_constant", None, message)
    other = parsed.encoder.counts_per_rev if parsed.is_linear else parsed.encoder.counts_per_metre
    if other is not None:
        given, right = ("counts_per_rev", "counts_per_metre")[:: 1 if parsed.is_linear else -1]
        yield Problem(source, f"encoder.{given}", shown(other), f"a {parsed.device} device has {right}")
    units: list[tuple[str, Signal | Time | None, Iterable[str]]] = [
        ("time.unit", parsed.time, TIME_UNITS),
        ("position.unit", parsed.position, [COUNT, *parsed.position_units]),
        ("current.unit", parsed.current, CURRENT_UNITS),
        ("current_measured.unit", parsed.current_measured, CURRENT_UNITS),
        ("force.unit", parsed.force, parsed.force_units),
    ]
    for key, part, valid in units:
        unit = part.unit if part is not None else None
        if unit is not None and unit not in valid:
            allowed = tuple(valid)
            yield Problem(source, key, shown(unit), f"must be one of {', '.join(allowed)}", allowed)
