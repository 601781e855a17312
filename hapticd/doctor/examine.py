"""All checks, and the verdict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from hapticd.doctor import _storage, kernel, processors
from hapticd.doctor.device import device
from hapticd.doctor.finding import Finding, Findings, Level, Machine

if TYPE_CHECKING:
    from hapticd.config import Config

CHECKS: Final[tuple[Callable[[Machine, Config], Finding], ...]] = (
    *kernel.CHECKS,
    *processors.CHECKS,
    *_storage.CHECKS,
)


@dataclass(frozen=True)
class Examination(Findings):
    """The result of ``hapticd doctor``."""

    rate_hz: float

    @property
    def verdict(self) -> str:
        """One sentence."""
        rate, notes = f"{self.rate_hz:g} Hz", self.named(Level.NOTE)
        if not self.fit:
            return f"Not fit for {rate}: {self.named(Level.BAD)}."
        if notes:
            return f"Fit for {rate}, but expect late ticks from: {notes}. 'hapticd latency' measures them."
        return f"Fit for {rate}. 'hapticd latency' measures how late ticks are."

    def document(self) -> dict[str, Any]:
        """The JSON form."""
        return {"fit": self.fit, "verdict": self.verdict, "rate_hz": self.rate_hz, "findings": self.listed()}


def examine(config: Config, machine: Machine | None = None) -> Examination:
    """Check the machine for a configuration. It changes nothing, except for a test file that is removed again."""
    machine = machine or Machine()
    findings = [check(machine, config) for check in CHECKS]
    findings += device(machine, config)
    return Examination(tuple(findings), config.servo.rate_hz)
