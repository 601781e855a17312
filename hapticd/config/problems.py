"""What can be wrong with a configuration, and how it is said.

One line a problem: file, key path, value, then what is allowed with its unit, or the nearest valid key.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

Limit = float | str | tuple[str, ...] | None


@dataclass(frozen=True)
class Problem:
    """One thing wrong with a configuration.

    Attributes:
        file: the file, preset or other source that holds it ("command line", "request").
        key: dotted key path, as in ``servo.rate_hz``; empty when the whole source is meant.
        value: the offending value as YAML text; None when the problem is not about a value.
        message: what is wrong and what is allowed, in words.
        limit: the bound that is violated, or the allowed names.
        unit: unit of value and limit.
        nearest: the valid key or name that was probably meant.
    """

    file: str
    key: str
    value: str | None
    message: str
    limit: Limit = None
    unit: str | None = None
    nearest: str | None = None

    def __str__(self) -> str:
        parts = [_one_line(self.file)]
        if self.key:
            key = _one_line(self.key if len(self.key) <= _LONGEST_KEY else f"{self.key[: _LONGEST_KEY - 1]}…")
            parts.append(key if self.value is None else f"{key} = {self.value}")
        return ": ".join([*parts, self.message])


_MOST_SHOWN = 20
_LONGEST_KEY = 200


def _one_line(name: str) -> str:
    """Names of files and keys are the user's: control characters in them must not reach the terminal."""
    return name if name.isprintable() else ascii(name)


class ConfigError(Exception):
    """A configuration that cannot be used; ``str()`` is the text for the user, one line a problem, the first twenty of them.

    Attributes:
        problems: everything that is wrong, never empty.
    """

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = list(problems)
        more = len(self.problems) - _MOST_SHOWN
        lines = [str(problem) for problem in self.problems[:_MOST_SHOWN]]
        super().__init__("\n".join([*lines, f"and {more} more"] if more > 0 else lines))


@dataclass(frozen=True)
class Finding:
    """A problem found inside a model's validator, before file and full key path are known.

    Attributes:
        key: key path relative to the model that found it.
        value: the offending value, or ``NO_VALUE``.
        message: as in :class:`Problem`; limit and nearest alike.
        involves: dotted keys that the finding depends on; when one of them is itself wrong, this is not reported.
        unit: of value and limit, where the key is not one of the schema's own.
    """

    key: str
    value: object
    message: str
    limit: Limit = None
    nearest: str | None = None
    involves: frozenset[str] = field(default_factory=frozenset)
    unit: str | None = None


NO_VALUE = object()
