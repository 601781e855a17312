"""All cases of a benchmark in numbers: rates, confusion, coverage, gaps, times, and the goals reached or not."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from benchmarks.gap import score
from benchmarks.gap.recipes import VISIBILITY
from benchmarks.gap.score import Answer, Rate, Truth

VERDICTS = ("no_missing_effect", "ambiguous", "unexplained", "failed")
_SEEN = ("clear", "strong")


class Scored(NamedTuple):
    """One case with its answer."""

    truth: Truth
    answer: Answer


class Goal(NamedTuple):
    """One line of what must hold."""

    name: str
    rate: Rate
    bound: str
    limit: float

    @property
    def reached(self) -> bool | None:
        """Whether the measured share keeps the bound; None without a case."""
        if not self.rate.of:
            return None
        return self.rate.value >= self.limit if self.bound == "≥" else self.rate.value <= self.limit


def load(root: Path, who: str) -> list[Scored]:
    """Every answered case of a benchmark's folder: here, and only here, the truth is opened."""
    return [
        Scored(json.loads((root / "truth" / path.name).read_text()), json.loads(path.read_text()))
        for path in sorted((root / who).glob("*.json"))
    ]


def _of_kind(scored: Iterable[Scored], kind: str, strengths: Sequence[str] | None = None) -> list[Scored]:
    return [
        one for one in scored if one.truth["kind"] == kind and (strengths is None or one.truth["strength"] in strengths)
    ]


def rate(scored: Sequence[Scored], holds: Callable[[Scored], bool]) -> Rate:
    """How many of the cases something holds for."""
    return Rate(sum(holds(one) for one in scored), len(scored))


def is_right(one: Scored) -> bool:
    """Named first, see `score.outcome`."""
    return score.outcome(one.answer, one.truth["slugs"][0]) == "right"


def is_wrong(one: Scored) -> bool:
    """Sure of a wrong name."""
    return score.confident_wrong(one.answer, one.truth["slugs"])


def held_out_after(answer: Answer) -> float | None:
    """The held-out gap of the improved model."""
    value = answer.get("gap", {}).get("held_out", {}).get("after")
    return None if value is None else float(value)


def coverage(scored: Iterable[Scored], *, sizes_only: bool) -> Rate:
    """Parameters of rightly named effects inside their 95 % intervals."""
    found = [
        holds
        for one in scored
        if is_right(one) and one.answer["verdict"] == "effect_found"
        for name, holds in score.inside(one.answer, one.truth)
        if not sizes_only or name in score.SIZE_PARAMETERS or name.startswith("amplitude")
    ]
    return Rate(sum(found), len(found))


def goals(scored: Sequence[Scored]) -> list[Goal]:
    """What must hold, line by line."""
    seen = _of_kind(scored, "single", _SEEN)
    named = [one for one in seen if is_right(one) and held_out_after(one.answer) is not None]
    closed = rate(named, lambda one: (held_out_after(one.answer) or 0.0) <= 1.2)
    barely = _of_kind(scored, "single", ["barely"])
    pairs, none, left_out = (_of_kind(scored, kind) for kind in ("pair", "none", "left_out"))
    alarms = rate(none, lambda one: one.answer.get("verdict") != "no_missing_effect")
    return [
        Goal("clear and strong: named first", rate(seen, is_right), "≥", 0.95),
        Goal("  size inside its 95 % interval", coverage(seen, sizes_only=True), "≥", 0.90),
        Goal("  every parameter inside", coverage(seen, sizes_only=False), "≥", 0.90),
        Goal("  held-out gap after ≤ 1.2", closed, "≥", 0.95),
        Goal("barely visible: confident wrong name", rate(barely, is_wrong), "≤", 0.05),
        Goal("nothing hidden: false alarm", alarms, "≤", 0.02),
        Goal(
            "two hidden: both named",
            rate(pairs, lambda one: score.both_named(one.answer, one.truth["slugs"])),
            "≥",
            0.80,
        ),
        Goal("class left out: confident wrong name", rate(left_out, is_wrong), "≤", 0.10),
    ]


class Row(NamedTuple):
    """One effect at one strength."""

    slug: str
    strength: str
    outcomes: Counter[str]
    visibility: float
    gap_after: float | None
    covered: Rate
    seconds: float


def by_effect(scored: Iterable[Scored]) -> list[Row]:
    """Single hidden effects, effect by effect and strength by strength."""
    cells: dict[tuple[str, str], list[Scored]] = defaultdict(list)
    for one in _of_kind(scored, "single"):
        cells[one.truth["slugs"][0], one.truth["strength"]].append(one)
    order = list(VISIBILITY)
    rows = []
    for (slug, strength), cell in sorted(cells.items(), key=lambda item: (item[0][0], order.index(item[0][1]))):
        after = [value for one in cell if (value := held_out_after(one.answer)) is not None]
        rows.append(
            Row(
                slug,
                strength,
                Counter(score.outcome(one.answer, slug) for one in cell),
                median(one.truth["visibility"] for one in cell),
                median(after) if after else None,
                coverage(cell, sizes_only=True),
                median(one.answer["wall_s"] for one in cell),
            )
        )
    return rows


def confusion(scored: Iterable[Scored], strengths: Sequence[str] = _SEEN) -> dict[str, Counter[str]]:
    """Hidden effect (or ``none``) to how often each first name or verdict was the answer."""
    found: dict[str, Counter[str]] = defaultdict(Counter)
    for one in scored:
        kind = one.truth["kind"]
        if kind == "none":
            found["none"][score.first_name(one.answer)] += 1
        elif kind == "single" and one.truth["strength"] in strengths:
            found[one.truth["slugs"][0]][score.first_name(one.answer)] += 1
    return dict(found)


def wrong_cases(scored: Iterable[Scored]) -> list[dict[str, Any]]:
    """Cases with a surely wrong name, an error or a false alarm, for those who want to know why."""
    listed = []
    for one in scored:
        truth, answer = one
        alarm = truth["kind"] == "none" and answer.get("verdict") != "no_missing_effect"
        if alarm or "error" in answer or is_wrong(one):
            listed.append(
                {
                    "case": truth["name"],
                    "hidden": truth["slugs"],
                    "kind": truth["kind"],
                    "strength": truth["strength"],
                    "device": truth["device"],
                    "named": score.names_of(answer),
                    "verdict": answer.get("verdict", "failed"),
                    "error": answer.get("error", "").strip().splitlines()[-1:],
                }
            )
    return listed
