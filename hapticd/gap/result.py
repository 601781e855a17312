"""What the gap workflow found, as `gap.json` has it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hapticd.gap.traces import Trace

Verdict = Literal["effect_found", "no_missing_effect", "ambiguous", "unexplained"]


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
    gap: float
    """Held-out gap with it."""
    evidence: float
    """Its gain over the model before the round, in standard errors."""
    behind: float
    """How far it is behind the first of the round, in standard errors; 0 for the first."""


@dataclass(frozen=True)
class Step:
    """One effect that was added."""

    effect: str
    parameters: Mapping[str, Estimate]
    gap_before: float
    gap_after: float
    """Held-out gap without and with it, all effects before it included."""
    evidence: float
    """Held-out gain in standard errors; see docs/explanation/gap-statistics.md."""
    log_likelihood_gain: float
    """Held-out gain in log-likelihood."""
    indistinguishable_from: tuple[str, ...]
    """Other effects that predict these data as well, those of the same exact class first."""
    ranking: tuple[Ranked, ...]
    """All candidates of the round that improved on the model before."""
    entry: Mapping[str, object] = field(default_factory=dict)
    """The effect as an entry of `plant.effects` of the improved model."""


@dataclass(frozen=True)
class GapNumbers:
    """RMS multi-step prediction error over the noise floor: 1 is as good as the data allow."""

    train_before: float
    train_after: float
    held_out_before: float
    held_out_after: float
    noise_floor: float
    """RMS prediction error that noise and quantisation alone leave [rad or m]."""


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
    structure: tuple[str, ...] = ()
    """What the remaining residual still depends on, in words; empty where it is noise or too little to matter."""
    residual_structure: Mapping[str, Any] = field(default_factory=dict)
    """The tests behind that; see `hapticd.gap.structure`."""
    base: Mapping[str, Estimate] = field(default_factory=dict)
    """Base parameters, where they were fitted too."""
    where: tuple[Mapping[str, Any], ...] = ()
    confounded: tuple[Mapping[str, Any], ...] = ()
    """Pairs of effects that explain the same missing torque; see `hapticd.gap.disagreement.confounded`."""
    balance: Mapping[str, Any] = field(default_factory=dict)
    """Which effects explain the missing force or torque; see `hapticd.gap.disagreement.balance_json`."""
    next_experiment: Mapping[str, Any] | None = None
    warnings: tuple[str, ...] = ()
    traces: tuple[Trace, ...] = ()
    """Window by window, for the report's figures; not part of `gap.json`."""
    details: Mapping[str, Any] = field(default_factory=dict)
    """Windows, samples, noise and thresholds behind the numbers."""

    def to_json(self) -> dict[str, Any]:
        """The document `gap.json`, of plain types."""
        return {
            "verdict": self.verdict,
            "statement": self.statement,
            "effects": list(self.effects),
            "steps": [_step(step) for step in self.steps],
            "where": [dict(entry) for entry in self.where],
            "confounded": [dict(pair) for pair in self.confounded],
            "balance": dict(self.balance),
            "gap": {
                "train": {"before": self.gap.train_before, "after": self.gap.train_after},
                "held_out": {"before": self.gap.held_out_before, "after": self.gap.held_out_after},
                "noise_floor": self.gap.noise_floor,
            },
            "structure": list(self.structure),
            "residual_structure": dict(self.residual_structure),
            "base": {name: _estimate(value) for name, value in self.base.items()},
            "next_experiment": dict(self.next_experiment) if self.next_experiment else None,
            "warnings": list(self.warnings),
            "details": dict(self.details),
        }


def _estimate(estimate: Estimate) -> dict[str, Any]:
    return {"value": estimate.value, "ci95": list(estimate.ci95), "unit": estimate.unit}


def _step(step: Step) -> dict[str, Any]:
    return {
        "effect": step.effect,
        "parameters": {name: _estimate(value) for name, value in step.parameters.items()},
        "gap_before": step.gap_before,
        "gap_after": step.gap_after,
        "evidence": step.evidence,
        "log_likelihood_gain": step.log_likelihood_gain,
        "indistinguishable_from": list(step.indistinguishable_from),
        "ranking": [asdict(ranked) for ranked in step.ranking],
        "entry": dict(step.entry),
    }
