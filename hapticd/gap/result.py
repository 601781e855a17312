"""The result of the gap workflow, as in `gap.json`."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from hapticd.gap.profile import Profile
    from hapticd.gap.validation import Validation

Verdict = Literal["effect_found", "partly_explained", "no_missing_effect", "ambiguous", "unexplained"]


@dataclass(frozen=True)
class Estimate:
    """A parameter with its 95 % confidence interval."""

    value: float
    ci95: tuple[float, float]
    unit: str


@dataclass(frozen=True)
class Ranked:
    """One candidate of a round."""

    effect: str
    gain: float
    """Held-out gain over the model before the round, nats."""
    evidence: float
    """The same in standard errors."""
    behind: float
    """Distance to the chosen one in standard errors; 0 for that one."""


@dataclass(frozen=True)
class Step:
    """One effect that was added."""

    effect: str
    parameters: Mapping[str, Estimate]
    gap_before: float
    gap_after: float
    """RMS of the missing force without and with it, with all earlier effects in the model [N m or N]."""
    share: float
    """Share of the explainable missing power that it removes."""
    evidence: float
    """Held-out gain in standard errors; see docs/explanation/gap-statistics.md."""
    log_likelihood_gain: float
    """Held-out gain in nats."""
    indistinguishable_from: tuple[str, ...]
    """Other effects that predict these data as well, equivalent laws first."""
    ranking: tuple[Ranked, ...]
    """All candidates of the round that were fitted."""
    entry: Mapping[str, object] = field(default_factory=dict)
    """The effect as an entry of `plant.effects` of the improved model."""


@dataclass(frozen=True)
class GapNumbers:
    """RMS of the missing force or torque while the shaft moves, in `unit`."""

    train_before: float
    train_after: float
    held_out_before: float
    held_out_after: float
    """Held out: each block with parameters estimated without its fold."""
    noise_floor: float
    """The noise floor."""
    unit: str


@dataclass(frozen=True)
class Remainder:
    """The missing force that remains with the named effects."""

    share: float
    """Share of the missing power before."""
    words: str
    structure: tuple[Mapping[str, Any], ...]
    """Coordinates that it depends on: coordinate, share, p_value."""
    fingerprint: tuple[str, ...] = ()
    """Lines in time and orders in angle, in words."""


@dataclass(frozen=True)
class GapResult:
    """Verdict, effects with their uncertainty, and how far the gap shrank."""

    verdict: Verdict
    statement: str
    """The verdict in one sentence."""
    effects: tuple[str, ...]
    """Slugs in the order in which they were added."""
    steps: tuple[Step, ...]
    gap: GapNumbers
    remainder: Remainder
    where: tuple[Mapping[str, Any], ...] = ()
    base: Mapping[str, Estimate] = field(default_factory=dict)
    """Base parameters that were fitted."""
    assumed_friction: Mapping[str, float] = field(default_factory=dict)
    """Frictions that are 0 in the model, and the reference value of their relative corrections."""
    prediction: Mapping[str, Any] = field(default_factory=dict)
    """Errors of predictions over a horizon and of a free run, before and after; see `hapticd.gap.prediction`."""
    validation: Validation | None = None
    """The same on a recording that was not fitted, if there is one."""
    recording: Mapping[str, Any] = field(default_factory=dict)
    """Timing quality of the recordings, and limits of the conclusions."""
    next_experiment: Mapping[str, Any] | None = None
    details: Mapping[str, Any] = field(default_factory=dict)
    """Samples, blocks, noise and thresholds behind the numbers."""
    interrupted: bool = False
    """Whether the search was interrupted: the result has what was found until then, and more may be missing."""
    profiles: tuple[Profile, ...] = ()
    """The missing force at each sample before and after, for the figures; not part of `gap.json`."""

    def __repr__(self) -> str:
        return f"GapResult({self.verdict}: {self.statement})"

    @property
    def warnings(self) -> Sequence[str]:
        """Limits of the conclusions, in words."""
        return tuple(self.recording.get("warnings", ()))

    def to_json(self) -> dict[str, Any]:
        """The document of `gap.json`, with plain types."""
        return {
            "verdict": self.verdict,
            "statement": self.statement,
            "interrupted": self.interrupted,
            "effects": list(self.effects),
            "steps": [asdict(step) for step in self.steps],
            "where": [dict(entry) for entry in self.where],
            "gap": {
                "train": {"before": self.gap.train_before, "after": self.gap.train_after},
                "held_out": {"before": self.gap.held_out_before, "after": self.gap.held_out_after},
                "noise_floor": self.gap.noise_floor,
                "unit": self.gap.unit,
            },
            "remainder": asdict(self.remainder),
            "prediction": dict(self.prediction),
            "validation": self.validation.to_json() if self.validation else None,
            "recording": dict(self.recording),
            "base": {name: asdict(value) for name, value in self.base.items()},
            "next_experiment": dict(self.next_experiment) if self.next_experiment else None,
            "warnings": list(self.warnings),
            "details": dict(self.details),
        }
