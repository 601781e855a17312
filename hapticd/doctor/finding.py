"""The result of a check, and access to the machine."""

from __future__ import annotations

import enum
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any


class Level(enum.StrEnum):
    """Whether a finding matters at the configured rate."""

    GOOD = "good"
    NOTE = "note"
    """The loop runs, with a disadvantage."""
    BAD = "bad"
    """The loop does not run as configured, or not safely."""


@dataclass(frozen=True)
class Finding:
    """One line of the report."""

    name: str
    level: Level
    found: str
    matters: str = ""
    """Why it matters, and at which rate."""
    fix: str = ""
    """The command that repairs it."""


@dataclass(frozen=True)
class Findings:
    """The findings, one per line."""

    findings: tuple[Finding, ...]

    @property
    def fit(self) -> bool:
        """Whether no finding is bad."""
        return not self.named(Level.BAD)

    def named(self, level: Level) -> str:
        """The names of the findings of a level, with commas."""
        return ", ".join(finding.name for finding in self.findings if finding.level is level)

    def listed(self) -> list[dict[str, Any]]:
        """The JSON form of the lines."""
        return [asdict(finding) for finding in self.findings]


@dataclass(frozen=True)
class Machine:
    """Reads files of the machine, below another root in tests.

    Args:
        root: of the file system.
    """

    root: Path = field(default_factory=lambda: Path("/"))

    def path(self, name: str) -> Path:
        """A path below the root."""
        return self.root / name.lstrip("/")

    def read(self, name: str) -> str | None:
        """Text of a small file, stripped; None if it cannot be read."""
        try:
            return self.path(name).read_text(errors="replace").strip()
        except OSError:
            return None

    def number(self, name: str) -> int | None:
        """Number in a small file; None if there is none."""
        text = self.read(name)
        try:
            return int(text) if text is not None else None
        except ValueError:
            return None

    def glob(self, pattern: str) -> list[Path]:
        """Sorted paths below the root."""
        return sorted(self.root.glob(pattern.lstrip("/")))


def cpu_list(text: str | None) -> frozenset[int]:
    """CPU numbers from the kernel's list format, such as ``0-2,5``; empty if invalid."""
    cpus: set[int] = set()
    for part in (text or "").split(","):
        first, _, last = part.strip().partition("-")
        if first.isdigit() and (not last or last.isdigit()):
            cpus.update(range(int(first), int(last or first) + 1))
    return frozenset(cpus)
