"""Designs the experiment that distinguishes laws which the present data do not.

Optimal design for discrimination between competing models (Atkinson and Fedorov 1975): choose the experiment that maximises
the smallest misfit of a wrong model to the data of the true one. All experiments are simulated, with safety trips and
quantisation (`trial.py`). The criterion is the one for recorded data: standard errors of the log-likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from hapticd.gap import constants, grip, options
from hapticd.gap.law_set import evidence
from hapticd.gap.trial import CompetingModel, competing_model, separation

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hapticd.config import Config
    from hapticd.gap.choose import Named
    from hapticd.gap.law_set import LawSet
    from hapticd.servo.experiment import Experiment

FILE = "next_experiment.yaml"
MOST_MODELS = 3
"""Laws that one experiment should distinguish: the chosen one and the next best."""
_WANTED = 2.0 * constants.INDISTINGUISHABLE
_HOPELESS = 1.0
"""Expected standard errors below which an experiment is not proposed."""
_SHORTEST_S, _LONGEST_S = 4.0, 30.0
_BEST = 2
_WORTH_IT = 1.15
"""Factor by which other live settings must improve the separation to be proposed."""


@dataclass(frozen=True)
class Scored:
    """An experiment and its worst-case separation in standard errors."""

    experiment: Experiment
    expected: float


def next_experiment(
    model: Config, chosen: LawSet, named: Sequence[Named], progress: Callable[[float, str], None]
) -> dict[str, Any] | None:
    """Design the experiment that best separates tied laws.

    Args:
        model: loop, limits and nominal device.
        chosen: the set of laws. named: its laws, with the ties of each.
        progress: called with the fraction done and the present step.

    Returns:
        ``next_experiment`` of gap.json; None if no law is tied.
    """
    ambiguous = [one for one in named if one.ties]
    if not ambiguous:
        return None
    groups = [_competing_models(model, chosen, one) for one in ambiguous]
    names = [[one.law, *(tie.laws[-1] for tie in one.ties[: MOST_MODELS - 1])] for one in ambiguous]
    listed = "; ".join(f"{', '.join(group[:-1])} and {group[-1]}" for group in names)
    separates = list(dict.fromkeys(name for group in names for name in group))
    now = min(_now(chosen, one) for one in ambiguous)
    nothing = {"separates": separates, "now": now, "experiment": None, "file": None}
    found = design(model, [pair for group in groups for pair in pairs(group)], progress)
    simpler = f"prefer the simpler law, {' and '.join(_simplest(chosen, one) for one in ambiguous)}."
    if found is None:
        sentence = f"No experiment within the limits distinguishes {listed} on this device; {simpler}"
        return {"words": sentence, "expected": None, **nothing}
    if found.expected < _HOPELESS:
        sentence = f"With the fitted values, no experiment within the limits distinguishes {listed}; {simpler}"
        return {"words": sentence, "expected": found.expected, **nothing}
    sentence = (
        f"Play {found.experiment.describe(model.is_linear)}: expected separation of {listed}: {found.expected:.1f} "
        f"standard errors (these data: {now:.1f}; {constants.INDISTINGUISHABLE:g} are needed)."
    )
    if found.expected < constants.INDISTINGUISHABLE:
        sentence += (
            f" It is the best experiment within the limits of the config, and may not suffice: until then {simpler}"
        )
    if grip.SLUG in separates:
        sentence += " Nobody may hold the handle during the experiment."
    plan = {"experiment": found.experiment.document(), "file": FILE}
    return {"words": sentence, "separates": separates, "expected": found.expected, "now": now, **plan}


def _competing_models(model: Config, chosen: LawSet, one: Named) -> list[CompetingModel]:
    """The chosen set and its ties, except sets whose laws exclude each other."""
    sets = (chosen, *one.ties[: MOST_MODELS - 1])
    found = [competing_model(model, laws.fit) for laws in sets]
    return [each for each in found if each is not None]


def _now(chosen: LawSet, one: Named) -> float:
    """Standard errors by which the present data separate the tied laws."""
    return max(min(float(evidence(chosen, tie)[1]) for tie in one.ties), 0.0)


def _simplest(chosen: LawSet, one: Named) -> str:
    """Of the tied laws the one with the fewest parameters."""
    fewest = min(one.ties, key=lambda tie: tie.numbers)
    return fewest.laws[-1] if fewest.numbers < chosen.numbers else one.law


def pairs(models: Sequence[CompetingModel]) -> list[tuple[CompetingModel, CompetingModel]]:
    """Pairs (true model, claimed model): the first model against each other one, both ways."""
    return [pair for other in models[1:] for pair in ((models[0], other), (other, models[0]))]


def design(
    model: Config, tests: Sequence[tuple[CompetingModel, CompetingModel]], progress: Callable[[float, str], None]
) -> Scored | None:
    """The experiment with the best worst-case separation of all pairs; None if no experiment is within the limits.

    Args:
        model: loop and limits. tests: pairs (true model, claimed model). progress: as in `next_experiment`.
    """
    if not tests:
        return None
    tried = options.shapes(model)
    most = len(tried) + _BEST * 3 + 1
    done = 0

    def score(experiments: Sequence[Experiment], enough: int) -> list[Scored]:
        """The scored experiments, the best first; one that is worse than `enough` others is not simulated to its end."""
        nonlocal done
        results: list[Scored] = []
        for experiment in experiments:
            progress(done / most, f"trying {experiment.excitation}")
            done += 1
            least = results[enough - 1].expected if len(results) >= enough else 0.0
            expected = separation(experiment, tests, least)
            if expected is not None:
                results.append(Scored(experiment, expected))
                results.sort(key=lambda scored: -scored.expected)
        return results

    plain = score(tried, _BEST)
    if not plain:
        return None
    changed = score([other for best in plain[:_BEST] for other in options.with_settings(model, best.experiment)], 1)
    best = plain[0]
    if changed and changed[0].expected > _WORTH_IT * best.expected:
        best = changed[0]
    # Standard errors grow with the square root of the duration.
    needed = options.TRIAL_S * (_WANTED / max(best.expected, 0.1)) ** 2
    duration_s = float(round(min(max(needed, _SHORTEST_S), _LONGEST_S)))
    longer = score([replace(best.experiment, duration_s=duration_s)], 1)
    return longer[0] if longer else best
