"""Find where a model and recordings part, name what is missing, add it, and go round until nothing is left to name."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers import declared_latency
from hapticd.gap import noise, ties, verdict
from hapticd.gap.candidates import BUILDERS
from hapticd.gap.context import Context
from hapticd.gap.design import next_experiment
from hapticd.gap.disagreement import balance_json, confounded, disagreement, force_balance
from hapticd.gap.evidence import few_windows
from hapticd.gap.fit import fit
from hapticd.gap.hypothesis import Hypothesis
from hapticd.gap.intervals import estimates, posterior
from hapticd.gap.prepare import prepare
from hapticd.gap.result import Estimate, GapNumbers, GapResult, Ranked, Step
from hapticd.gap.revise import Round, dropped, prefix, replaced
from hapticd.gap.rivals import rival
from hapticd.gap.search import Data, Judged, judge, search
from hapticd.gap.structure import residual_structure
from hapticd.gap.traces import traces_of
from hapticd.plant.layout import device_vector, word

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from hapticd.config import Config
    from hapticd.gap.data import Recording

    Floats = NDArray[np.float64]

_MOST_EFFECTS = 4
_MOST_STEPS = 16
_FAR_OFF, _BEYOND_CHANCE = 10.0, 100.0
"""Times noise: what a slip that went the other way by chance may leave, and what none does."""
_BASE = {"inertia_error": "inertia", "viscous_friction": "viscous", "coulomb_friction": "coulomb"}
"""What `refit_base` fits: effect and the base parameter that it corrects."""


def find_gap(
    recordings: Sequence[Recording],
    model: Config,
    *,
    refit_base: bool = False,
    candidates: Sequence[str] | None = None,
    seed: int = 0,
    progress: Callable[[float, str], None] | None = None,
    workers: int | None = None,
    design: bool = True,
) -> GapResult:
    """Find the effects that a model lacks.

    Args:
        recordings: one or several runs of the same device.
        model: the nominal model.
        refit_base: fit inertia and friction of the base model too, before and with every effect.
        candidates: slugs to consider; the whole catalogue by default.
        seed: of everything random.
        progress: told the share done and what is being done.
        workers: threads.
        design: where rivals stay tied, design the experiment that would tell them apart; takes up to a minute.

    Raises:
        ValueError: no recording, or an unknown candidate.
    """
    if not recordings:
        raise ValueError("there is no recording to compare the model with")
    slugs = list(BUILDERS) if candidates is None else list(candidates)
    if unknown := [slug for slug in slugs if slug not in BUILDERS]:
        raise ValueError(f"unknown effect {unknown[0]!r}: the catalogue has {', '.join(BUILDERS)}")
    told = progress or (lambda share, text: None)
    told(0.0, "reading the windows")
    model = _on_driver_of(recordings, model)
    base = Hypothesis(device_vector(model, declared_latency(model)[0]))
    data = prepare(recordings, base)
    present = judge(data, fit(data.segments, base, np.zeros(0), [s.first_states() for s in data.segments]))
    data, present = _with_noise(data, present)
    nominal = present
    fixed: tuple[str, ...] = ()
    if refit_base:
        present = _refitted(data, present)
        fixed = present.hypothesis.slugs
        slugs = [slug for slug in slugs if slug not in (*_BASE, "torque_constant_error")]
    present, rounds = _explained(data, present, slugs, told, workers)
    result = _result(data, nominal, present, rounds, len(fixed), seed)
    vector = device_vector(model, declared_latency(model)[0])
    places = disagreement(recordings, model, float(vector[word("delay_s")]), seed)
    noted = tuple(warning for recording in recordings for warning in recording.warnings)
    details = {**result.details, "candidates": slugs}
    result = replace(result, where=tuple(places), warnings=noted, details=details)
    if (screening := force_balance(recordings, model, refit_base)) is not None:
        result = replace(
            result,
            balance=balance_json(screening, slugs, model.is_linear),
            confounded=tuple(confounded(screening, result.effects)),
        )
    if design and result.verdict == "ambiguous":
        start = 1.0 - 1.0 / (len(rounds) + 2.0)
        planned = _next_experiment(
            model,
            data,
            rounds,
            seed,
            lambda share, what: told(start + share * (1.0 - start), f"next experiment: {what}"),
        )
        result = replace(result, next_experiment=planned)
    told(1.0, "done")
    return result


def _explained(
    data: Data, base: Judged, slugs: Sequence[str], told: Callable[[float, str], None], workers: int | None
) -> tuple[Judged, list[Round]]:
    """Add effects to a base model one by one, each time looking back at the earlier ones, until nothing is left to name."""
    present, fixed = base, len(base.hypothesis.terms)
    rounds: list[Round] = []
    look_back = False

    for step in range(_MOST_STEPS):

        def report(share: float, slug: str, step: int = step, number: int = len(rounds) + (not look_back)) -> None:
            told(1.0 - (1.0 - share / (step + 2.0)) / (step + 1.0), f"effect {number}: {slug}")

        if look_back:
            present, rounds, look_back = replaced(data, present, rounds, fixed, report, workers)
            if look_back:
                present, rounds = dropped(data, present, rounds, fixed)
            continue
        used = {slug for found in rounds for slug in (found.winner, *ties.exact_class(found.winner))}
        remaining = [slug for slug in slugs if slug not in used]
        if not remaining or len(rounds) == _MOST_EFFECTS:
            break
        device = present.hypothesis.device(present.fit.solution.u, 0).vector
        judged = search(data, present, Context(data.segments, present.fit, device), remaining, report, workers)
        winner = _winner(judged, present, data, len(slugs))
        if winner is None:
            break
        judged[winner] = _polished(data, judged[winner])
        rounds.append(Round(winner, present, judged[winner], judged))
        present, rounds = dropped(data, judged[winner], rounds, fixed)
        look_back = len(rounds) > 1
    return present, rounds


def _refitted(data: Data, nominal: Judged) -> Judged:
    """The base model with its inertia and friction fitted. The torque constant stays: all four together are one scale."""
    hypothesis = nominal.hypothesis
    context = Context(data.segments, nominal.fit, hypothesis.base)
    for slug in _BASE:
        for term in BUILDERS[slug](context)[:1]:
            hypothesis = hypothesis.with_term(term)
    return judge(data, fit(data.segments, hypothesis, hypothesis.start(), nominal.fit.solution.states))


def _next_experiment(
    model: Config, data: Data, rounds: Sequence[Round], seed: int, told: Callable[[float, str], None]
) -> dict[str, Any] | None:
    """The experiment for the first round that ended in a tie."""
    for found in rounds:
        tied = ties.across_classes(found.winner, ties.rivals(found.winner, found.judged, data))
        if tied:
            best = found.judged[found.winner]
            claims = [rival(model, found.judged[slug], rounds[-1].after, slug) for slug in (found.winner, *tied)]
            now = min(best.ahead_of(found.judged[slug], data) for slug in tied)
            noise = float(np.median(np.concatenate([segment.extra_sigma for segment in data.segments])))
            return next_experiment(model, [claim for claim in claims if claim], noise, now, told, seed)
    return None


def _on_driver_of(recordings: Sequence[Recording], model: Config) -> Config:
    """The model behind the driver that made the recordings: its declared latency is part of the way of a command."""
    known = [recording.config.driver for recording in recordings if recording.config]
    return model.model_copy(update={"driver": known[0]}) if known else model


def _with_noise(data: Data, present: Judged) -> tuple[Data, Judged]:
    """The same windows with the noise that the samples show, and the base model fitted again."""
    segments = []
    for number, segment in enumerate(data.segments):
        error = present.fit.residuals[number] * segment.sigma[:, None]
        ticks = segment.windows.rows
        speed = np.sqrt(np.mean(segment.velocity[ticks] ** 2, axis=1))
        crossings = speed * segment.recording.period_s / segment.resolution
        found = noise.estimate(error, speed, crossings, segment.resolution)
        extra = found.extra(speed)
        sigma = np.sqrt(segment.resolution**2 / 12.0 + extra)
        segments.append(replace(segment, sigma=sigma, extra_sigma=np.sqrt(extra)))
    data = Data(segments, data.block)
    solution = present.fit.solution
    return data, judge(data, fit(segments, solution.hypothesis, solution.u, solution.states))


def _winner(judged: dict[str, Judged], present: Judged, data: Data, catalogue: int) -> str | None:
    """The significant candidate that predicts held-out windows best, or a simpler one as good (`ties.first`)."""
    good = [slug for slug, j in judged.items() if j.against(present, data).significant(catalogue * j.trials)]
    return ties.first(good, judged, data) if good else None


def _polished(data: Data, judged: Judged) -> Judged:
    """The fit carried to the end: fits that only rank candidates stop early."""
    solution = judged.fit.solution
    return judge(data, fit(data.segments, solution.hypothesis, solution.u, solution.states), judged.trials)


def _floor_of(data: Data, judged: Judged, seed: int) -> Floats:
    """Mean squares (w, replicas) in position units that noise alone leaves."""
    predicted = [s.observed - r * s.sigma[:, None] for s, r in zip(data.segments, judged.fit.residuals, strict=True)]
    squares = noise.floor(data.segments, predicted, judged.fit.at, np.random.default_rng(seed))
    return np.concatenate([q * s.sigma[:, None] ** 2 for q, s in zip(squares, data.segments, strict=True)])


def _square(data: Data, mean_square: Floats) -> Floats:
    """Mean squares (w,) in position units."""
    return np.asarray(mean_square * np.concatenate([s.sigma**2 for s in data.segments]))


def _gap(square: Floats, floor: Floats) -> float:
    return float(np.sqrt(square.mean() / floor.mean()))


def _result(data: Data, nominal: Judged, final: Judged, rounds: list[Round], fixed: int, seed: int) -> GapResult:
    floor = _floor_of(data, final, seed)
    is_linear = data.segments[0].recording.is_linear

    def gap_of(judged: Judged) -> float:
        return _gap(_square(data, judged.held_out.mean_square), floor)

    where = posterior(data.segments, final.fit, data.block, seed)
    steps, tied_across = [], []
    chain = _chain(data, final, rounds, fixed)
    for number, found in enumerate(rounds):
        tied = ties.rivals(found.winner, found.judged, data)
        same = ties.exact_class(found.winner)
        across = ties.across_classes(found.winner, tied)
        tied_across.append(across)
        comparison = found.after.against(found.before, data)
        term = final.hypothesis.terms[fixed + number]
        share = final.hypothesis.share(where.centre, fixed + number)
        entry = term.entry(share) if term.entry else term.parameters(share)
        steps.append(
            Step(
                effect=found.winner,
                parameters=estimates(final.hypothesis, where, fixed + number, is_linear),
                gap_before=gap_of(chain[number]),
                gap_after=gap_of(chain[number + 1]),
                evidence=comparison.z,
                log_likelihood_gain=0.5 * comparison.gain,
                indistinguishable_from=(*same, *across),
                ranking=tuple(_ranking(found, data, gap_of)),
                entry={"name": found.winner, **entry},
            )
        )
    square = _square(data, final.held_out.mean_square)
    structure = residual_structure(data, final, seed)
    few = few_windows(len(square), final.hypothesis.is_rugged)
    left = verdict.Remaining(
        _gap(square, floor),
        _trimmed_gap(square, floor, few),
        _many_far_off(square / floor.mean(), few),
        tuple(test.name for test in structure.left),
    )
    effects = tuple(found.winner for found in rounds)
    answer, statement = verdict.decide(effects, tied_across, left)
    train = [_gap(_square(data, j.fit.solution.mean_square), floor) for j in (nominal, final)]
    numbers = GapNumbers(train[0], train[1], gap_of(nominal), left.gap, float(np.sqrt(floor.mean())))
    details = {
        "windows": int(sum(s.count for s in data.segments)),
        "window_s": [s.length * s.recording.period_s for s in data.segments],
        "samples": int(data.samples),
        "blocks": len(np.unique(data.block)),
        "position_noise": [float(np.median(s.extra_sigma)) for s in data.segments],
    }
    traces = traces_of(data, nominal, final, numbers.noise_floor)
    base = {
        _BASE[slug]: _scaled(estimates(final.hypothesis, where, number, is_linear)["r"], final.hypothesis.base, slug)
        for number, slug in enumerate(final.hypothesis.slugs[:fixed])
    }
    return GapResult(
        answer,
        statement,
        effects,
        tuple(steps),
        numbers,
        structure=left.structure,
        residual_structure=structure.to_json(),
        traces=traces,
        base=base,
        details=details,
    )


def _chain(data: Data, final: Judged, rounds: Sequence[Round], fixed: int) -> list[Judged]:
    """The model without any effect, with the first, and so on to the last."""
    if len(rounds) < 2:
        return [*(found.before for found in rounds), final]
    return [*(prefix(data, final, fixed + number) for number in range(len(rounds))), final]


def _scaled(relative: Estimate, vector: Floats, slug: str) -> Estimate:
    """A base parameter from its relative correction r."""
    nominal = float(vector[word(_BASE[slug])])
    low, high = relative.ci95
    return Estimate(nominal * (1.0 + relative.value), (nominal * (1.0 + low), nominal * (1.0 + high)), "")


def _trimmed_gap(square: Floats, floor: Floats, few: int) -> float:
    """The gap without the worst few windows: a marginal slip that went the other way says nothing of missing physics."""
    keep = len(square) - few
    return float(np.sqrt(np.sort(square)[:keep].sum() / len(square) / floor.mean()))


def _many_far_off(square: Floats, few: int) -> bool:
    """Whether windows are further off, in mean squares (w,) over the floor's, than slips by chance can explain."""
    far = np.sum(square > _FAR_OFF**2) > few // 2
    return bool(far or np.any(square > _BEYOND_CHANCE**2))


def _ranking(found: Round, data: Data, gap_of: Callable[[Judged], float]) -> list[Ranked]:
    best = found.judged[found.winner]
    rows = []
    for slug, judged in sorted(found.judged.items(), key=lambda item: float(item[1].held_out.loss.sum())):
        behind = 0.0 if slug == found.winner else best.ahead_of(judged, data)
        rows.append(Ranked(slug, gap_of(judged), judged.against(found.before, data).z, behind))
    return rows
