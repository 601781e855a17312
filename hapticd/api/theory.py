"""Stability analysis of a config, without any motion."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hapticd.config.assumed import assumed, assumed_text
from hapticd.config.limits import limits_off, limits_text
from hapticd.config.loading import ConfigSource, config_of
from hapticd.config.units import deflection_ticks, split, velocity_ticks
from hapticd.stability.advice import Change, Unit, advise
from hapticd.stability.assessment import Assessment, assess
from hapticd.stability.guard import Judgement, judge
from hapticd.stability.report import report
from hapticd.stability.uncertainty import Confidence, confidence

if TYPE_CHECKING:
    from hapticd.config import Config


@dataclass(frozen=True)
class Check:
    """Result of the stability analysis; ``print`` shows it as ``hapticd check`` does.

    Attributes:
        assessment: operating point, bounds, margins, limit cycle. changes: each alone makes an unstable motion stable.
        guard: what the daemon's stability guard would do. warnings: effects that the theory ignores, limits that are off.
        confidence: probabilities from ``plant.uncertainty``; None if the config has none.
        assumed: keys of the device that are missing in the config; then nothing is proven.
    """

    assessment: Assessment
    changes: tuple[Change, ...]
    guard: Judgement
    warnings: tuple[str, ...]
    confidence: Confidence | None
    assumed: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """``stable``, ``depends`` (on the speed), ``buzzes``, ``unstable``, or ``undecided``."""
        return self.assessment.verdict

    @property
    def region(self) -> str:
        """Region of the paper's Fig. 3, or Fig. 5 with a delay."""
        return self.assessment.region

    @property
    def document(self) -> dict[str, Any]:
        """The keys of ``hapticd check --json``; numbers may be infinite."""
        sure = {} if self.confidence is None else {"probability": self.confidence.document}
        return self.assessment.document | {
            "warnings": list(self.warnings),
            "changes": [change.document for change in self.changes],
            "guard": self.guard.document,
            **({"assumed": list(self.assumed)} if self.assumed else {}),
            **sure,
        }

    def __repr__(self) -> str:
        return (
            f"Check({self.verdict}, region {self.region}, {len(self.changes)} changes, {len(self.warnings)} warnings)"
        )

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(str(self))}</pre>"

    def __str__(self) -> str:
        return report(self.assessment, self.changes, "config", None)


def check(
    config: ConfigSource = None,
    *,
    deflection: float | str | None = None,
    velocity: float | str | None = None,
    settings: Mapping[str, Any] | None = None,
) -> Check:
    """Analyse whether a spring is stable, why, and which change would help.

    Args:
        config: a `Config`, nested mappings, a file, a preset's name; None for the simulated RE35 testbed.
        deflection: for a release at rest from this deflection, in coarse ticks; or ``"30deg"``, ``"2mm"``.
        velocity: for a motion through the origin at this speed, in coarse ticks per period; or ``"60rpm"``.
        settings: dotted key to value, applied to the config.

    Raises:
        ConfigError: the config is invalid. DriverConfigError: an option that its driver does not have.
        UnitError: a unit of another quantity.
        ValueError: both a deflection and a velocity, or numbers beyond floating point.
    """
    from drivers import check_option_names, declared_latency

    resolved = config_of(config, settings)
    check_option_names(resolved)
    ticks = None if deflection is None else deflection_ticks(deflection, resolved)
    speed = None if velocity is None else velocity_ticks(velocity, resolved)
    latency, doubt = declared_latency(resolved)
    found = assess(resolved, deflection=ticks, velocity=speed, latency_s=latency, jobs=None)
    judgement = judge(resolved, latency, deflection=ticks, velocity=speed, release=True)
    off = limits_off(resolved)
    doubts = (doubt, f"limits that are {limits_text(off)}" if off else None, assumed_text(resolved))
    warnings = (*found.warnings, *(each for each in doubts if each))
    return Check(
        found,
        tuple(advise(found, _asked_in(resolved, deflection, velocity))),
        judgement,
        warnings,
        confidence(found),
        assumed(resolved),
    )


def _asked_in(config: Config, deflection: float | str | None, velocity: float | str | None) -> Unit | None:
    """The unit of deflection or velocity; None for ticks."""
    for given, ticks in ((deflection, deflection_ticks), (velocity, velocity_ticks)):
        if isinstance(given, str) and (unit := split(given)[1]):
            return Unit(unit, ticks(f"1{unit}", config))
    return None
