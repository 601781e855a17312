"""The benchmark's report: tables as text, the confusion matrices as pictures, everything as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.gap import figure, score, summary
from benchmarks.gap.cases import write_atomically, write_json
from benchmarks.gap.plan import Case, is_for_development
from benchmarks.gap.rate import Rate
from benchmarks.gap.summary import COLUMNS, Goal, Row, Scored

PEERS = {"sindy": "PySINDy"}
"""Folder of the answers, and name."""
_COLUMN = 50
_YES_NO = {True: "reached", False: "NOT REACHED", None: ""}


def _percent(rate: Rate) -> str:
    return f"{100 * rate.value:.0f} %" if rate.of else "-"


def _bounds(bounds: tuple[float, float] | None) -> str:
    if bounds is None:
        return ""
    low, high = (f"{100 * bound:.0f}" for bound in bounds)
    if low == "0":
        return f"≤ {high} %"
    return f"≥ {low} %" if high == "100" else f"{low}–{high} %"


def _cell(rate: Rate, bounds: tuple[float, float] | None, reached: bool | None) -> str:
    text = f"{rate!s:28}{_bounds(bounds)} {_YES_NO[reached]}" if rate.of else "-"
    return f"{text:{_COLUMN}}"


def goal_table(goals: Sequence[Goal]) -> str:
    """Shares with their Wilson intervals of 95 %, in all columns; where something is asked for, whether it is reached.

    Lines without a case are left out.
    """
    lines = [f"{'':36}" + "".join(f"{column:{_COLUMN}}" for column in COLUMNS).rstrip()]
    for goal in goals:
        if not goal.rates.everything.of:
            continue
        cells = map(_cell, goal.rates, goal.bounds, goal.reached)
        lines.append(f"{goal.name:36}{''.join(cells)}".rstrip())
    return "\n".join(lines)


def effect_table(rows: Sequence[Row]) -> str:
    """Single hidden effects, two lines an effect."""
    names = " ".join(f"{name:>11}" for name in score.OUTCOMES)
    lines = [f"{'hidden':24} {'strength':8} {'vis.':>6}  {names}  {'+ wrong':>7} {'inside CI':>10} {'s':>6}"]
    for row in rows:
        strength = f"{'≥' if row.strong else '<'} {summary.STRONG}"
        counts = " ".join(f"{row.outcomes[name] or '·':>11}" for name in score.OUTCOMES)
        end = f"{row.further or '·':>7} {_percent(row.covered):>10} {row.seconds:6.1f}"
        lines.append(f"{row.slug:24} {strength:8} {row.visibility:6.2f}  {counts}  {end}")
    return "\n".join(lines)


def costs(scored: Sequence[Scored]) -> str:
    """Time and memory a case."""
    memory = np.array([one.answer["peak_memory_MB"] for one in scored])
    lines = [f"{memory.size} cases: {np.median(memory):.0f} MB in the median, {memory.max():.0f} MB at most"]
    for key, words in (("processor_s", "of one core"), ("wall_s", "by the clock")):
        spent = np.array([one.answer[key] for one in scored])
        lines.append(
            f"{np.median(spent):.1f} s {words} in the median, {np.quantile(spent, 0.95):.1f} s at 95 %, {spent.max():.1f} s "
            "at most"
        )
    return "; ".join(lines)


def beside(own: Sequence[Scored], peer: Sequence[Scored], name: str) -> str:
    """The workflow and a peer on the cases that both were asked."""
    both = {one.truth["name"] for one in own} & {one.truth["name"] for one in peer}
    parts = [f"{len(both)} cases that hapticd and {name} were asked"]
    for title, scored in (("hapticd", own), (name, peer)):
        shared = [one for one in scored if one.truth["name"] in both]
        parts.append(f"{title}\n{goal_table(summary.goals(shared))}\n{costs(shared)}")
    return "\n".join(parts)


def title(cases: Sequence[Case], answered: int) -> str:
    """Which seeds, and what they are for."""
    seeds = sorted({case.seed for case in cases})
    purpose = "to develop on" if is_for_development(seeds[0]) else "for the report"
    return f"seeds {seeds[0]} to {seeds[-1]}, {purpose}: {answered} of {len(cases)} cases answered"


def _list(rates: Mapping[str, Rate]) -> str:
    return "\n".join(f"{name:44}{rate}" for name, rate in rates.items())


def write(root: Path, cases: Sequence[Case]) -> str:
    """Score what is answered of some cases, write report.txt, report.json and pictures, and return the text.

    Raises:
        FileNotFoundError: nothing is answered yet.
    """
    own = summary.load(root, "workflow", cases)
    if not own:
        raise FileNotFoundError(f"{root / 'workflow'} has no answers to these cases")
    goals, confusion = summary.goals(own), summary.confusion(own)
    parts = [title(cases, len(own)), goal_table(goals)]
    parts.append("First names by what a perfect observer sees\n" + goal_table(summary.by_visibility(own)))
    parts.append(f"First names, strength ≥ {summary.STRONG}, by the coloured torque\n" + _list(summary.by_torque(own)))
    parts.append(effect_table(summary.by_effect(own)))
    parts.append("Inside the 95 % intervals, parameter by parameter\n" + _list(summary.by_parameter(own)))
    if confusion:
        parts.append(f"First names, strength ≥ {summary.STRONG}\n" + figure.text(confusion))
        figure.draw(confusion, root / "confusion.png", f"hapticd gap, strength ≥ {summary.STRONG}")
    parts.append(costs(own))
    document = {"title": parts[0], **_document(own)}
    for who, name in PEERS.items():
        if peer := summary.load(root, who, cases):
            parts.append(beside(own, peer, name))
            document[who] = _document(peer)
            if of_both := summary.confusion(peer):
                figure.draw(of_both, root / f"confusion_{who}.png", f"{name}, the same cases")
    text = "\n\n".join(parts) + "\n"
    write_atomically(root / "report.txt", text.encode())
    write_json(root / "report.json", document)
    return text


def _share(rate: Rate, bounds: tuple[float, float] | None, reached: bool | None) -> dict[str, Any]:
    return {"hits": rate.hits, "of": rate.of, "wilson": list(rate.interval), "wanted": bounds, "reached": reached}


def _lines(goals: Sequence[Goal]) -> list[dict[str, Any]]:
    section, lines = "", []
    for goal in goals:
        section = section if goal.name.startswith(" ") else goal.name
        name = goal.name if goal.name == section else f"{section}:{goal.name[1:]}"
        cells = zip(COLUMNS, goal.rates, goal.bounds, goal.reached, strict=True)
        lines.append({"name": name, **{column: _share(*cell) for column, *cell in cells}})
    return lines


def _counts(rates: Mapping[str, Rate]) -> dict[str, list[int]]:
    return {name: [rate.hits, rate.of] for name, rate in rates.items()}


def _document(scored: Sequence[Scored]) -> dict[str, Any]:
    return {
        "cases": len(scored),
        "goals": _lines(summary.goals(scored)),
        "visibility": _lines(summary.by_visibility(scored)),
        "effects": [
            {**row._asdict(), "outcomes": dict(row.outcomes), "covered": [row.covered.hits, row.covered.of]}
            for row in summary.by_effect(scored)
        ],
        "parameters": _counts(summary.by_parameter(scored)),
        "coloured_torque": _counts(summary.by_torque(scored)),
        "confusion": {row: dict(counts) for row, counts in summary.confusion(scored).items()},
        "answers": [
            {
                "case": one.truth["name"],
                "hidden": one.truth["slugs"],
                "named": one.answer.get("effects", []),
                "verdict": score.verdict_of(one.answer),
                "wall_s": one.answer["wall_s"],
                "processor_s": one.answer["processor_s"],
                "peak_memory_MB": one.answer["peak_memory_MB"],
            }
            for one in scored
        ],
        "to_look_at": summary.wrong_cases(scored),
    }
