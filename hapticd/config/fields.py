"""Building blocks of the schema: strict numbers, limits, and fields that carry their unit.

true, "5" and nan are not numbers. A *limit* may be 0 or null for "no limit"; its value is then None. An *ideal* quantity
(bandwidth, DAC bits) may be 0 or null for "ideal"; its value is then 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from numbers import Real
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, StrictBool, StrictStr, model_validator
from pydantic_core import PydanticCustomError

from hapticd.config.problems import Finding


def findings_error(findings: Iterable[Finding]) -> PydanticCustomError:
    """The error that a validator raises to report findings."""
    return PydanticCustomError("findings", "wrong configuration", {"findings": list(findings)})


SMALLEST, LARGEST = 1e-18, 1e18
"""Range of a physical quantity: no device is outside, and powers and quotients of quantities in it are finite."""
MAGNITUDE = f"must be 0, or of {SMALLEST:g} to {LARGEST:g}"


def is_quantity(number: float) -> bool:
    """Whether a finite number is in the range of a physical quantity, or 0."""
    return number == 0.0 or SMALLEST <= abs(number) <= LARGEST


def _finite(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise PydanticCustomError("not_a_number", "must be a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise PydanticCustomError("not_finite", "must be finite")
    return number + 0.0  # -0.0 becomes 0.0: equal configurations are written alike


def _number(value: Any) -> float:
    number = _finite(value)
    if not is_quantity(number):
        raise PydanticCustomError("no_quantity", MAGNITUDE)
    return number


def _whole(value: Any) -> int:
    if not _finite(value).is_integer():
        raise PydanticCustomError("not_whole", "must be a whole number")
    return int(value)


def _or_null(read: Callable[[Any], float], held: float | None) -> BeforeValidator:
    """A number, for which 0 and null are the same."""
    return BeforeValidator(lambda value: held if value is None else read(value) or held)


def _off(value: Any) -> Any:
    return "off" if value is False else value


Number = Annotated[float, BeforeValidator(_number)]
Whole = Annotated[int, BeforeValidator(_whole)]
Limit = Annotated[float | None, _or_null(_number, None)]
WholeLimit = Annotated[int | None, _or_null(_whole, None)]
Ideal = Annotated[float, _or_null(_number, 0.0)]
WholeIdeal = Annotated[int, _or_null(_whole, 0)]
Off = BeforeValidator(_off)
"""For fields with the choice ``off``, which YAML 1.1 reads as false."""
Flag = StrictBool
Text = StrictStr


def quantity(
    default: Any,
    meaning: str,
    unit: str = "",
    *,
    linear: str = "",
    zero: str = "",
    linear_default: float | None = None,
    **constraints: float,
) -> Any:
    """A documented field.

    Args:
        default: default value; a callable is evaluated each time.
        meaning: one sentence for the reference, the JSON Schema and the help texts.
        unit: unit for a rotary device; empty for none.
        linear: unit for a linear device, if different.
        zero: meaning of 0 or null ("no limit", "no lag"), for fields that allow it.
        linear_default: default for a linear device, if different.
        constraints: ``ge``, ``gt``, ``le``, ``lt``.
    """
    named = {"unit": unit, "unit_linear": linear, "zero_or_null": zero, "default_linear": linear_default}
    extra = {name: value for name, value in named.items() if value not in ("", None)}
    arguments: dict[str, Any] = {"description": meaning, "json_schema_extra": extra, **constraints}
    return Field(default_factory=default, **arguments) if callable(default) else Field(default, **arguments)


class Section(BaseModel):
    """One section of the configuration: immutable, and without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @model_validator(mode="before")
    @classmethod
    def _empty_sections(cls, data: Any) -> Any:
        """A section whose keys are all commented out is null: use the defaults."""
        if not isinstance(data, Mapping):
            return data
        return {key: {} if value is None and key in cls.subsections() else value for key, value in data.items()}

    @classmethod
    def subsections(cls) -> dict[str, type[Section]]:
        """Name and model of each section directly inside this one."""
        kinds = {name: field.annotation for name, field in cls.model_fields.items()}
        return {name: kind for name, kind in kinds.items() if isinstance(kind, type) and issubclass(kind, Section)}
