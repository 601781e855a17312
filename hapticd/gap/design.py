"""The experiment that tells apart what the data at hand cannot.

Optimal design for discrimination between rival models (Atkinson and Fedorov 1975): of all experiments that may be run, take
the one in which the rival that fits the other's data best still fits them worst. Here the experiments are few enough to be
tried one by one in simulation, safety trips and quantisation included, and the measure is the one by which the recorded data
will be judged: held-out standard errors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from hapticd.gap import options
from hapticd.gap.rivals import HAND, Rival, pairs
from hapticd.gap.ties import RESOLVED
from hapticd.gap.trial import separation

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hapticd.config import Config
    from hapticd.servo.experiment import Experiment

FILE = "next_experiment.yaml"
MOST_RIVALS = 3
_WANTED = 2.0 * RESOLVED
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
    model: Config,
    rivals: Sequence[Rival],
    noise: float,
    now: float,
    told: Callable[[float, str], None],
    seed: int = 0,
) -> dict[str, Any] | None:
    """Design the experiment that separates rivals best.

    Args:
        model: loop, limits and nominal device.
        rivals: what the data cannot tell apart, the best first.
        noise: standard deviation of a position sample beyond quantisation, rad or m.
        now: standard errors by which the data at hand separate them.
        told: told(share done, what is being done).
        seed: of everything random.

    Returns:
        ``next_experiment`` of gap.json; None where fewer than two can be simulated.
    """
    if len(rivals) < 2:
        return None
    rivals = rivals[:MOST_RIVALS]
    found = design(model, rivals, noise, told, seed)
    names = [rival.slug for rival in rivals]
    listed = f"{', '.join(names[:-1])} and {names[-1]}"
    nothing = {"separates": names, "now": now, "experiment": None, "file": None}
    if found is None:
        words = f"No experiment that the limits admit moves the shaft: {listed} cannot be told apart on this device."
        return {"words": words, "expected": None, **nothing}
    if found.expected < _HOPELESS:
        words = (
            f"With the values that fit, {listed} are the same device to every experiment that the limits admit; "
            "take the one with fewer parameters."
        )
        return {"words": words, "expected": found.expected, **nothing}
    words = (
        f"Play {found.experiment.describe(model.is_linear)}: expected separation of {listed}: {found.expected:.1f} "
        f"standard errors (these data: {now:.1f}; {RESOLVED:g} are needed)."
    )
    if found.expected < RESOLVED:
        words += " It is the best that the limits of the config admit, and may not be enough."
    if HAND in names:
        words += " Nobody may hold the handle."
    plan = {"experiment": found.experiment.document(), "file": FILE}
    return {"words": words, "separates": names, "expected": found.expected, "now": now, **plan}


def design(
    model: Config, rivals: Sequence[Rival], noise: float, told: Callable[[float, str], None], seed: int = 0
) -> Scored | None:
    """The best experiment; arguments as in `next_experiment`. None where none may be run at all."""
    tests = pairs(rivals)
    tried = options.shapes(model)
    most = len(tried) + _BEST * 3 + 1
    done = 0

    def score(experiments: Sequence[Experiment]) -> list[Scored]:
        nonlocal done
        results = []
        for experiment in experiments:
            told(done / most, f"trying {experiment.excitation}")
            done += 1
            expected = separation(experiment, tests, noise, seed)
            if expected is not None:
                results.append(Scored(experiment, expected))
        return sorted(results, key=lambda scored: -scored.expected)

    plain = score(tried)
    if not plain:
        return None
    changed = score([other for best in plain[:_BEST] for other in options.with_settings(model, best.experiment)])
    best = plain[0]
    if changed and changed[0].expected > _WORTH_IT * best.expected:
        best = changed[0]
    # Standard errors grow with the root of the time.
    needed = options.TRIAL_S * (_WANTED / max(best.expected, 0.1)) ** 2
    duration_s = float(round(min(max(needed, _SHORTEST_S), _LONGEST_S)))
    longer = score([replace(best.experiment, duration_s=duration_s)])
    return longer[0] if longer else best
