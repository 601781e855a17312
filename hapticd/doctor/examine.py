"""All checks, and the verdict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from hapticd.doctor import kernel, processors, storage
from hapticd.doctor.device import device
from hapticd.doctor.finding import Finding, Level, Machine

if TYPE_CHECKING:
    from hapticd.config import Config

CHECKS: Final[tuple[Callable[[Machine, Config], Finding], ...]] = (
    *kernel.CHECKS,
    *processors.CHECKS,
    *storage.CHECKS,
)


@dataclass(frozen=True)
class Examination:
    """What ``hapticd doctor`` found."""

    rate_hz: float
    findings: tuple[Finding, ...]

    @property
    def fit(self) -> bool:
        """Nothing found that keeps the loop from running as configured."""
        return all(finding.level is not Level.BAD for finding in self.findings)

    @property
    def verdict(self) -> str:
        """One sentence."""
        rate = f"{self.rate_hz:g} Hz"
        bad = [finding.name for finding in self.findings if finding.level is Level.BAD]
        notes = [finding.name for finding in self.findings if finding.level is Level.NOTE]
        if bad:
            return f"Not fit for {rate}: {', '.join(bad)}."
        if notes:
            return (
                f"Fit for {rate}, with late ticks to expect from: {', '.join(notes)}. 'hapticd latency' measures them."
            )
        return f"Fit for {rate}. 'hapticd latency' says how late it is."

    def document(self) -> dict[str, Any]:
        """The JSON form."""
        return {
            "fit": self.fit,
            "verdict": self.verdict,
            "rate_hz": self.rate_hz,
            "findings": [
                {
                    "name": finding.name,
                    "level": finding.level.value,
                    "found": finding.found,
                    "matters": finding.matters,
                    "fix": finding.fix,
                }
                for finding in self.findings
            ],
        }


def examine(config: Config, machine: Machine | None = None) -> Examination:
    """Look at the machine on behalf of a configuration. Nothing is changed, but for a trial file that is removed."""
    machine = machine or Machine()
    findings = [check(machine, config) for check in CHECKS]
    findings += device(machine, config)
    return Examination(config.servo.rate_hz, tuple(findings))
