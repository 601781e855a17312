"""Checks of a request body's fields beyond their type; pydantic is imported when a body is checked."""

import math
from collections.abc import Callable
from typing import Annotated, Any, Final

from annotated_types import Gt, Le, Len

LONGEST_DURATION_S: Final = 3600.0
LONGEST_NOTE: Final = 2000
"""Characters."""


class Rule:
    """A check of a value in addition to its type; pydantic finds it by the names of its two methods.

    Args:
        check: takes the value and returns it; raises ValueError with what is valid.
        json_type: JSON Schema of a valid value, if not that of the type.
    """

    def __init__(self, check: Callable[[Any], Any], json_type: dict[str, Any] | None = None) -> None:
        self.check, self.json_type = check, json_type

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import PydanticCustomError, core_schema

        def checked(value: Any) -> Any:
            try:
                return self.check(value)
            except ValueError as error:
                raise PydanticCustomError("rule", str(error)) from None

        return core_schema.no_info_after_validator_function(checked, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return self.json_type or handler(schema)


def _scalar(value: Any) -> Any:
    """Check that a value is a YAML scalar."""
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("input should be a finite number")
    if value is not None and not isinstance(value, bool | int | float | str):
        raise ValueError("input should be a number, text, true, false or null")
    return value


def absolute(path: str | None) -> str | None:
    """Check that a path is absolute."""
    if path is not None and not path.startswith("/"):
        raise ValueError("the daemon has its own working directory: give an absolute path")
    return path


def release_steps(steps: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Check the form of a sequence's steps; the daemon checks their settings."""
    from hapticd.config.text import shown

    for number, step in enumerate(steps, 1):
        if unknown := step.keys() - {"settings", "deflection", "duration_s"}:
            raise ValueError(
                f"step {number}: unknown field {min(unknown)}; there are deflection, settings and duration_s"
            )
        if not _is_within(step.get("deflection"), -1e9, 1e9):
            said = shown(step.get("deflection"))
            raise ValueError(f"step {number}: deflection should be within ±1e9 coarse ticks, not {said}")
        duration_s = step.get("duration_s")
        if duration_s is not None and not (_is_within(duration_s, 0.0, LONGEST_DURATION_S) and duration_s > 0.0):
            limits = f"above 0 and at most {LONGEST_DURATION_S:g} s"
            raise ValueError(f"step {number}: duration_s should be {limits}, not {shown(duration_s)}")
        settings = step.get("settings") or {}
        if not isinstance(settings, dict):
            raise ValueError(f"step {number}: settings should be an object of dotted keys")
        for value in settings.values():
            _scalar(value)
    return steps


def _is_within(value: Any, low: float, high: float) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and low <= value <= high


STEPS: Final[dict[str, Any]] = {
    "type": "array",
    "minItems": 1,
    "maxItems": 500,
    "items": {
        "type": "object",
        "properties": {
            "deflection": {"type": "number"},
            "settings": {"type": "object"},
            "duration_s": {"type": "number", "exclusiveMinimum": 0, "maximum": LONGEST_DURATION_S},
        },
        "required": ["deflection"],
        "additionalProperties": False,
    },
}

_SCALARS: Final = {"anyOf": [{"type": name} for name in ("boolean", "integer", "number", "string", "null")]}
Setting = Annotated[Any, Rule(_scalar, _SCALARS)]
PathText = Annotated[str, Len(1, 4096)]
Positive = Annotated[float, Gt(0)]
Seconds = Annotated[float, Gt(0), Le(LONGEST_DURATION_S)]
Force = Annotated[bool, "Continue although in theory the motion does not die out; noted in log and run."]
