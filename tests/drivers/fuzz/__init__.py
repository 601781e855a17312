"""Fuzzing of protocol decoders: ``python -m tests.drivers.fuzz NAME [--count N] [--seed S]``.

A decoder's own folder knows how to attack it; here is what every attack reports and how it is judged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from scipy.stats import poisson

_FALSE_ALARM = 1e-9

Advance = Callable[[int], None]
"""Called now and then with the number of inputs done."""


@dataclass
class FuzzReport:
    """What came of the inputs.

    Attributes:
        inputs: byte strings given to the decoder.
        accepted: frames that were accepted and had been sent.
        rejected: frames that were refused, by reason.
        checked: wrong frames that only their check sequence could tell.
        wrong: of these, the ones that were accepted.
        odds: chance of a wrong frame to pass its check.
        violations: what may not happen at all, in words.
    """

    inputs: int = 0
    accepted: int = 0
    rejected: dict[str, int] = field(default_factory=dict)
    checked: int = 0
    wrong: int = 0
    odds: float = 0.0
    violations: list[str] = field(default_factory=list)

    @property
    def wrong_limit(self) -> int:
        """Wrong frames that a sound check exceeds once in 10⁹ campaigns."""
        return int(poisson.isf(_FALSE_ALARM, self.checked * self.odds)) if self.checked * self.odds else 0

    @property
    def failed(self) -> bool:
        """Whether anything happened that may not."""
        return bool(self.violations) or self.wrong > self.wrong_limit

    def lines(self) -> list[str]:
        """The summary for a person."""
        refused = ", ".join(f"{count} for {reason}" for reason, count in self.rejected.items())
        return [
            f"{self.inputs} inputs: {self.accepted} frames accepted as sent; rejected: {refused or 'none'}",
            f"wrong frames accepted: {self.wrong} of {self.checked} that reached the check, {self.checked * self.odds:.2f} "
            f"expected by its odds of 1 in {1 / self.odds:.0f}, at most {self.wrong_limit}"
            if self.odds
            else f"wrong frames accepted: {self.wrong}",
            *(f"VIOLATION: {text}" for text in self.violations),
            "FAILED" if self.failed else "passed",
        ]
