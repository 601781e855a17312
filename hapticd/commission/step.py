"""What a step says afterwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Verdict = Literal["pass", "fail", "skipped", "disturbed"]
"""``disturbed``: this machine was too busy for an answer; the same command tries again."""
_POINTS: Final = 600
"""A picture has no use for more points in a line."""


class StepError(Exception):
    """A step cannot say anything: the device or the daemon ended it; the text says how."""


class DisturbedError(StepError):
    """This machine was elsewhere for too long; the step may be tried again."""


@dataclass(frozen=True)
class Line:
    """One line of a picture; ``style``: line, steps or dots."""

    label: str
    x: Sequence[float]
    y: Sequence[float]
    style: Literal["line", "steps", "dots"] = "line"


@dataclass(frozen=True)
class Picture:
    """What is drawn of a step: lines over one axis, and instants or values worth a mark on it."""

    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    marks: Mapping[str, float] = field(default_factory=dict)
    """Text to x."""


def line(label: str, x: ArrayLike, y: ArrayLike, style: Literal["line", "steps", "dots"] = "line") -> Line:
    """A line thinned to what can be seen, of two arrays of one length."""
    xs, ys = np.asarray(x, float), np.asarray(y, float)
    kept = slice(None, None, max(1, -(-len(xs) // _POINTS)))
    return Line(label, xs[kept].tolist(), ys[kept].tolist(), style)


@dataclass(frozen=True)
class Result:
    """What a step found.

    Attributes:
        figures: name with its unit to number, text or None. limit: the same for what they were held against.
        finding: one sentence. cause: what is likely wrong. remedy: what to do about it.
        dangerous: nothing may move after this.
    """

    result: Verdict
    finding: str
    figures: Mapping[str, Any] = field(default_factory=dict)
    limit: Mapping[str, Any] = field(default_factory=dict)
    cause: str = ""
    remedy: str = ""
    dangerous: bool = False
    picture: Picture | None = None


@dataclass(frozen=True)
class Seen:
    """What a step has measured and holds it against; its two verdicts. `Result` describes the fields."""

    figures: Mapping[str, Any]
    limit: Mapping[str, Any]
    picture: Picture | None = None
    dangerous: bool = False
    """Whether nothing may move after a failure."""

    def passes(self, finding: str) -> Result:
        """It is as it must be."""
        return Result("pass", finding, self.figures, self.limit, picture=self.picture)

    def fails(self, finding: str, cause: str, remedy: str) -> Result:
        """It is not."""
        return Result("fail", finding, self.figures, self.limit, cause, remedy, self.dangerous, self.picture)


def skipped(reason: str) -> Result:
    """A result for what could not be looked at."""
    return Result("skipped", reason)
