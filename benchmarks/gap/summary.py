"""All cases of a benchmark in numbers: rates with and without a coloured torque, confusion, coverage, goals."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from benchmarks.gap import score
from benchmarks.gap.coverage import inside
from benchmarks.gap.plan import Case
from benchmarks.gap.rate import Rate
from benchmarks.gap.score import Answer, Truth

COLUMNS = ("all", "without", "with coloured torque")
STRONG = 0.3
"""From this strength on an effect is to be named."""
VISIBLE = (0.3, 1.0, 3.0)
"""Bounds between bands of visibility; a perfect observer's gap is √(1 + v²) times what noise alone leaves."""


class Scored(NamedTuple):
    """One case with its answer."""

    truth: Truth
    answer: Answer


class Rates(NamedTuple):
    """One share in all three `COLUMNS`."""

    everything: Rate
    without: Rate
    coloured: Rate


class Goal(NamedTuple):
    """One line of the report, with the bounds of each column where something is asked for."""

    name: str
    rates: Rates
    bounds: tuple[tuple[float, float] | None, ...] = (None, None, None)

    @property
    def reached(self) -> list[bool | None]:
        """Column by column, whether the measured share lies in its bounds; None without bounds or without a case."""
        return [
            bounds[0] <= rate.value <= bounds[1] if bounds is not None and rate.of else None
            for rate, bounds in zip(self.rates, self.bounds, strict=True)
        ]


def load(root: Path, who: str, cases: Iterable[Case]) -> list[Scored]:
    """The answered ones of some cases: here, and only here, the truth is opened."""
    paths = ((root / "truth" / f"{case.name}.json", root / who / f"{case.name}.json") for case in cases)
    return [
        Scored(json.loads(truth.read_text()), json.loads(answer.read_text()))
        for truth, answer in paths
        if answer.exists()
    ]


def of_kind(scored: Iterable[Scored], *kinds: str) -> list[Scored]:
    """The cases of some kinds."""
    return [one for one in scored if one.truth["kind"] in kinds]


def is_strong(one: Scored) -> bool:
    """Whether every effect that was drawn by strength is to be named."""
    return all(strength >= STRONG for strength in one.truth["strengths"])


def rate(scored: Iterable[Scored], holds: Callable[[Scored], bool]) -> Rate:
    """How many of the cases something holds for."""
    found = [holds(one) for one in scored]
    return Rate(sum(found), len(found))


def in_columns(scored: Iterable[Scored], measure: Callable[[list[Scored]], Rate]) -> Rates:
    """One share in all columns."""
    everything = list(scored)
    without = [one for one in everything if one.truth["coloured"] is None]
    coloured = [one for one in everything if one.truth["coloured"] is not None]
    return Rates(measure(everything), measure(without), measure(coloured))


def rates(scored: Iterable[Scored], holds: Callable[[Scored], bool]) -> Rates:
    """How many of the cases something holds for, in all columns."""
    return in_columns(scored, lambda some: rate(some, holds))


def is_named(one: Scored) -> bool:
    """The first name is a hidden effect."""
    return score.is_named(one.answer, one.truth["slugs"])


def is_wrong(one: Scored) -> bool:
    """Sure of a wrong name."""
    return score.confident_wrong(one.answer, one.truth["slugs"])


def has_wrong_further(one: Scored) -> bool:
    """A further name is none of the hidden effects."""
    return bool(score.wrong_further(one.answer, one.truth["slugs"]))


def are_all_named(one: Scored) -> bool:
    """Every hidden effect is named."""
    return score.all_named(one.answer, one.truth["slugs"])


def coverage(scored: Iterable[Scored]) -> Rate:
    """Parameters of rightly named effects inside their 95 % intervals."""
    found = [holds for one in scored for _, holds in inside(one.answer, one.truth)]
    return Rate(sum(found), len(found))


def _asked(low: float, high: float) -> tuple[tuple[float, float], ...]:
    return ((low, high),) * 3


def goals(scored: Sequence[Scored]) -> list[Goal]:
    """What must hold, and what is told beside it, line by line."""
    single, none = of_kind(scored, "single"), of_kind(scored, "none")
    strong = [one for one in single if is_strong(one)]
    weak = [one for one in single if not is_strong(one)]
    hidden = of_kind(scored, "single", "pair", "wrong_base")
    left_out = of_kind(scored, "left_out")
    found = [
        Goal(f"first name, strength ≥ {STRONG}", rates(strong, is_named), _asked(0.97, 1.0)),
        Goal("  confidently wrong", rates(strong, is_wrong)),
        Goal(f"first name, strength < {STRONG}", rates(weak, is_named)),
        Goal("  confidently wrong", rates(weak, is_wrong)),
        Goal("wrong further names, one hidden", rates(single, has_wrong_further), _asked(0.0, 0.02)),
        Goal(
            "false alarms, nothing hidden",
            rates(none, lambda one: score.is_alarm(one.answer)),
            (None, (0.0, 0.01), (0.0, 0.02)),
        ),
        Goal("  with a name", rates(none, lambda one: bool(score.names_of(one.answer)))),
        Goal("left-out class: confidently wrong", rates(left_out, is_wrong), _asked(0.0, 0.05)),
        Goal("inside the 95 % intervals", in_columns(hidden, coverage), _asked(0.90, 0.98)),
    ]
    for kind, words in (("pair", "two hidden"), ("wrong_base", "wrong base parameter")):
        some = of_kind(scored, kind)
        found += [
            Goal(f"{words}: both named", rates(some, are_all_named)),
            Goal("  first name is one of them", rates(some, is_named)),
            Goal("  wrong further names", rates(some, has_wrong_further)),
            Goal("  confidently wrong", rates(some, is_wrong)),
        ]
    return found


def by_visibility(scored: Iterable[Scored]) -> list[Goal]:
    """First names of single effects by what a perfect observer sees of them."""
    bands: dict[int, list[Scored]] = {band: [] for band in range(len(VISIBLE) + 1)}
    for one in of_kind(scored, "single"):
        bands[sum(one.truth["visibility"][0] >= bound for bound in VISIBLE)].append(one)
    edges = ["0", *(f"{bound:g}" for bound in VISIBLE), "∞"]
    return [
        Goal(f"visibility {edges[band]} to {edges[band + 1]}", rates(some, is_named)) for band, some in bands.items()
    ]


class Row(NamedTuple):
    """One effect, hidden alone, on one side of `STRONG`."""

    slug: str
    strong: bool
    outcomes: Counter[str]
    further: int
    visibility: float
    covered: Rate
    seconds: float


def by_effect(scored: Iterable[Scored]) -> list[Row]:
    """Single hidden effects, effect by effect."""
    cells: dict[tuple[str, bool], list[Scored]] = defaultdict(list)
    for one in of_kind(scored, "single"):
        cells[one.truth["slugs"][0], is_strong(one)].append(one)
    return [
        Row(
            slug,
            strong,
            Counter(score.outcome(one.answer, [slug]) for one in cell),
            sum(map(has_wrong_further, cell)),
            median(one.truth["visibility"][0] for one in cell),
            coverage(cell),
            median(one.answer["processor_s"] for one in cell),
        )
        for (slug, strong), cell in sorted(cells.items())
    ]


def by_parameter(scored: Iterable[Scored]) -> dict[str, Rate]:
    """Coverage of every parameter."""
    found: dict[str, list[bool]] = defaultdict(list)
    for one in of_kind(scored, "single", "pair", "wrong_base"):
        for name, holds in inside(one.answer, one.truth):
            found[name].append(holds)
    return {name: Rate(sum(held), len(held)) for name, held in sorted(found.items())}


def by_torque(scored: Iterable[Scored]) -> dict[str, Rate]:
    """First names of single effects of strength `STRONG` and above, by the coloured torque beside them."""
    found: dict[tuple[float, float], list[bool]] = defaultdict(list)
    for one in of_kind(scored, "single"):
        if is_strong(one):
            torque = one.truth["coloured"] or {"share": 0.0, "correlation_s": 0.0}
            found[torque["share"], torque["correlation_s"]].append(is_named(one))
    rated = {beside: Rate(sum(named), len(named)) for beside, named in sorted(found.items())}
    words = "{:.0f} % of the friction, {:.0f} ms"
    return {words.format(100 * share, 1e3 * tau) if share else "none": each for (share, tau), each in rated.items()}


def confusion(scored: Iterable[Scored]) -> dict[str, Counter[str]]:
    """Hidden effect of strength `STRONG` and above (or ``none``) to how often each first name or verdict was the answer."""
    found: dict[str, Counter[str]] = defaultdict(Counter)
    for one in of_kind(scored, "single", "none"):
        if is_strong(one):
            found[one.truth["slugs"][0] if one.truth["slugs"] else "none"][score.first_name(one.answer)] += 1
    return dict(found)


def wrong_cases(scored: Iterable[Scored]) -> list[dict[str, Any]]:
    """Cases with a surely wrong name, a wrong further one, an error or a false alarm, for those who want to know why."""
    listed = []
    for one in scored:
        truth, answer = one
        alarm = truth["kind"] == "none" and score.is_alarm(answer)
        if alarm or "error" in answer or is_wrong(one) or (truth["kind"] != "left_out" and has_wrong_further(one)):
            kept = ("kind", "strengths", "seed", "number", "device", "coloured", "visibility")
            listed.append(
                {
                    "case": truth["name"],
                    "hidden": truth["slugs"],
                    **{key: truth[key] for key in kept},
                    "named": score.names_of(answer),
                    "verdict": score.verdict_of(answer),
                    "error": answer.get("error", "").strip().splitlines()[-1:],
                }
            )
    return listed
