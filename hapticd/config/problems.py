"""Problems of a configuration, and their text.

One line per problem: file, key path, value, then what is allowed with its unit, or the nearest valid key.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

Limit = float | str | tuple[str, ...] | None


@dataclass(frozen=True)
class Problem:
    """One problem of a configuration.

    Attributes:
        file: the file, preset or other source ("command line", "request").
        key: dotted key path, as in ``servo.rate_hz``; empty for the whole source.
        value: the invalid value as YAML text; None if the problem is not about a value.
        message: what is wrong and what is allowed, in words.
        limit: the violated bound, or the allowed names.
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
    """Escape control characters in names of files and keys, which come from the user, for the terminal."""
    return name if name.isprintable() else ascii(name)


class ConfigError(Exception):
    """An invalid configuration; ``str()`` is the text for the user, one line per problem, at most twenty.

    Attributes:
        problems: all problems, never empty.
    """

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = list(problems)
        more = len(self.problems) - _MOST_SHOWN
        lines = [str(problem) for problem in self.problems[:_MOST_SHOWN]]
        super().__init__("\n".join([*lines, f"and {more} more"] if more > 0 else lines))


@dataclass(frozen=True)
class Finding:
    """A problem found in a model's validator, where file and full key path are unknown.

    Attributes:
        key: key path relative to the validated model.
        value: the invalid value, or ``NO_VALUE``.
        message: as in :class:`Problem`, also limit and nearest.
        involves: dotted keys that the finding depends on; if one of them is invalid, the finding is not reported.
        unit: of value and limit, if the key is not in the schema.
    """

    key: str
    value: object
    message: str
    limit: Limit = None
    nearest: str | None = None
    involves: frozenset[str] = field(default_factory=frozenset)
    unit: str | None = None


NO_VALUE = object()
