"""The experiment that tells apart what the data at hand cannot.

Optimal design for discrimination between competing models (Atkinson and Fedorov 1975): of all experiments that may be run,
take the one in which the model that fits the other's data best still fits them worst. Here the experiments are few enough to
be tried one by one in simulation, safety trips and quantisation included (`trial.py`), and the measure is the one by which
the recorded data will be judged: standard errors of the log-likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from hapticd.gap import constants, grip, options
from hapticd.gap.competition import evidence
from hapticd.gap.trial import CompetingModel, competing_model, separation

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hapticd.config import Config
    from hapticd.gap.competition import Round
    from hapticd.servo.experiment import Experiment

FILE = "next_experiment.yaml"
MOST_MODELS = 3
"""Laws of one round that an experiment should set apart: the one that was taken and the next best."""
_WANTED = 2.0 * constants.INDISTINGUISHABLE
_HOPELESS = 1.0
"""Expected standard errors below which an experiment is a waste of time."""
_SHORTEST_S, _LONGEST_S = 4.0, 30.0
_BEST = 2
_WORTH_IT = 1.15
"""Factor by which another setting must help to be asked for."""


@dataclass(frozen=True)
class Scored:
    """An experiment and the standard errors by which it separates, in the worst case."""

    experiment: Experiment
    expected: float


def next_experiment(
    model: Config, rounds: Sequence[Round], progress: Callable[[float, str], None], base: int = 0
) -> dict[str, Any] | None:
    """Design the experiment that separates best what the rounds of a search left open.

    Args:
        model: loop, limits and nominal device.
        rounds: of the search.
        progress: told the fraction done and what is being done.
        base: number of terms of every hypothesis, the first ones, that are base parameters.

    Returns:
        ``next_experiment`` of gap.json; None where nothing is left open.
    """
    ambiguous = [stage for stage in rounds if stage.indistinguishable]
    if not ambiguous:
        return None
    groups = [_competing_models(model, stage, rounds[-1], base) for stage in ambiguous]
    names = [[stage.taken.slug, *stage.indistinguishable[: MOST_MODELS - 1]] for stage in ambiguous]
    listed = "; ".join(f"{', '.join(group[:-1])} and {group[-1]}" for group in names)
    separates = list(dict.fromkeys(name for group in names for name in group))
    now = min(_now(stage) for stage in ambiguous)
    nothing = {"separates": separates, "now": now, "experiment": None, "file": None}
    found = design(model, [pair for group in groups for pair in pairs(group)], progress)
    simpler = f"prefer the simpler law, {' and '.join(_simplest(stage) for stage in ambiguous)}."
    if found is None:
        sentence = f"No experiment that the limits admit tells {listed} apart on this device; {simpler}"
        return {"words": sentence, "expected": None, **nothing}
    if found.expected < _HOPELESS:
        sentence = (
            f"With the values that fit, {listed} are one device to every experiment that the limits admit; {simpler}"
        )
        return {"words": sentence, "expected": found.expected, **nothing}
    sentence = (
        f"Play {found.experiment.describe(model.is_linear)}: expected separation of {listed}: {found.expected:.1f} "
        f"standard errors (these data: {now:.1f}; {constants.INDISTINGUISHABLE:g} are needed)."
    )
    if found.expected < constants.INDISTINGUISHABLE:
        sentence += f" It is the best that the limits of the config admit, and may not be enough: until then {simpler}"
    if grip.SLUG in separates:
        sentence += " Nobody may hold the handle."
    plan = {"experiment": found.experiment.document(), "file": FILE}
    return {"words": sentence, "separates": separates, "expected": found.expected, "now": now, **plan}


def _competing_models(model: Config, stage: Round, last: Round, base: int) -> list[CompetingModel]:
    """The effect that a round took and those that the data do not tell from it, as far as a device can have them."""
    slugs = stage.indistinguishable[: MOST_MODELS - 1]
    others = [contender for contender in stage.contenders if contender.slug in slugs]
    final = last.taken.judged.fit
    found = [competing_model(model, one.judged.fit, final, base) for one in (stage.taken, *others)]
    return [one for one in found if one is not None]


def _now(stage: Round) -> float:
    """Standard errors by which the data at hand separate the indistinguishable effects of a stage."""
    others = [contender for contender in stage.contenders if contender.slug in stage.indistinguishable]
    return max(min(float(evidence(stage.taken.judged, other.judged)[1]) for other in others), 0.0)


def _simplest(stage: Round) -> str:
    """Of the indistinguishable effects of a round the one with the fewest parameters."""
    among = [one for one in stage.contenders if one.slug in (stage.taken.slug, *stage.indistinguishable)]
    return min(among, key=lambda one: len(one.law.coordinates)).slug


def pairs(models: Sequence[CompetingModel]) -> list[tuple[CompetingModel, CompetingModel]]:
    """(what is true, what else is claimed): the first model against each other one, and the other way round."""
    return [pair for other in models[1:] for pair in ((models[0], other), (other, models[0]))]


def design(
    model: Config, tests: Sequence[tuple[CompetingModel, CompetingModel]], progress: Callable[[float, str], None]
) -> Scored | None:
    """The experiment that separates all pairs best in the worst case; None where none may be run at all.

    Args:
        model: loop and limits. tests: (what is true, what is claimed). progress: as in `next_experiment`.
    """
    if not tests:
        return None
    tried = options.shapes(model)
    most = len(tried) + _BEST * 3 + 1
    done = 0

    def score(experiments: Sequence[Experiment], enough: int) -> list[Scored]:
        """The best ones; what is worse than `enough` others is not looked at to its end."""
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
    # Standard errors grow with the root of the time.
    needed = options.TRIAL_S * (_WANTED / max(best.expected, 0.1)) ** 2
    duration_s = float(round(min(max(needed, _SHORTEST_S), _LONGEST_S)))
    longer = score([replace(best.experiment, duration_s=duration_s)], 1)
    return longer[0] if longer else best
