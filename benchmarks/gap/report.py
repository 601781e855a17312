"""The benchmark's report: tables as text, the confusion matrix as a picture, everything as JSON."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.gap import score, summary
from benchmarks.gap.cases import write_atomically, write_json
from benchmarks.gap.hidden import LAWS
from benchmarks.gap.summary import VERDICTS, Goal, Row, Scored

_YES_NO = {True: "reached", False: "NOT REACHED", None: "no case"}


def _percent(value: float) -> str:
    return "-" if value != value else f"{100 * value:.0f} %"


def goal_table(goals: Sequence[Goal]) -> str:
    """What must hold: measured, wanted, reached or not."""
    lines = [f"{'goal':38}  {'measured (95 % Wilson)':34}  wanted    "]
    lines += [f"{g.name:38}  {g.rate!s:34}  {g.bound} {100 * g.limit:3.0f} %   {_YES_NO[g.reached]}" for g in goals]
    return "\n".join(lines)


def effect_table(rows: Sequence[Row]) -> str:
    """Single hidden effects, one line an effect and strength."""
    head = f"{'hidden':24} {'strength':8} {'vis.':>6}  " + " ".join(f"{name:>11}" for name in score.OUTCOMES)
    lines = [head + f"  {'inside CI':>10} {'gap after':>9} {'s':>6}"]
    for row in rows:
        counts = " ".join(f"{row.outcomes[name] or '·':>11}" for name in score.OUTCOMES)
        after = "-" if row.gap_after is None else f"{row.gap_after:.2f}"
        inside = _percent(row.covered.value)
        lines.append(
            f"{row.slug:24} {row.strength:8} {row.visibility:6.2f}  {counts}  {inside:>10} {after:>9} {row.seconds:6.1f}"
        )
    return "\n".join(lines)


def confusion_axes(confusion: dict[str, Counter[str]]) -> tuple[list[str], list[str]]:
    """Rows and columns of the matrix: the catalogue's order, then the verdicts that name nothing."""
    rows = [slug for slug in (*LAWS, "none") if slug in confusion]
    named = {name for counts in confusion.values() for name in counts}
    return rows, [name for name in (*LAWS, *VERDICTS) if name in named or name in rows]


def confusion_text(confusion: dict[str, Counter[str]]) -> str:
    """Hidden effects down, first names across; columns are numbered and listed below."""
    rows, columns = confusion_axes(confusion)
    lines = [f"{'hidden':24}" + "".join(f"{number:>4}" for number in range(1, len(columns) + 1))]
    for row in rows:
        cells = "".join(f"{confusion[row][name] or '·':>4}" for name in columns)
        lines.append(f"{row:24}{cells}")
    lines += [f"{number:4} {name}" for number, name in enumerate(columns, 1)]
    return "\n".join(lines)


def confusion_figure(confusion: dict[str, Counter[str]], path: Path, title: str) -> None:
    """The matrix as a picture: shares of each row, counts in the cells."""
    from matplotlib.figure import Figure

    rows, columns = confusion_axes(confusion)
    counts = np.array([[confusion[row][name] for name in columns] for row in rows], float)
    shares = counts / counts.sum(axis=1, keepdims=True)
    figure = Figure(figsize=(2.5 + 0.36 * len(columns), 2.5 + 0.3 * len(rows)), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    axes.set_xticks(range(len(columns)), columns, rotation=90)
    axes.set_yticks(range(len(rows)), rows)
    axes.set(xlabel="first name, or verdict", ylabel="hidden", title=title)
    for (i, j), count in np.ndenumerate(counts):
        if count:
            colour = "white" if shares[i, j] > 0.6 else "black"
            axes.text(j, i, f"{count:.0f}", ha="center", va="center", fontsize=7, color=colour)
    figure.colorbar(image, label="share of the row", shrink=0.6)
    part = path.with_name(f".{path.name}.part.png")
    figure.savefig(part, dpi=130)
    part.replace(path)


def peer_table(scored: dict[str, list[Scored]]) -> str:
    """The workflow beside its peer on the cases that both have answered."""
    both = {
        one.truth["name"] for one in scored.get("peer", []) if one.truth["kind"] in ("single", "none")
    } & {one.truth["name"] for one in scored["workflow"]}  # fmt: skip
    lines = [f"{'on the same cases':18}  {'named first':32}  {'barely: wrong name':32}  {'false alarms':32}  s a case"]
    for who, answered in scored.items():
        shared = [one for one in answered if one.truth["name"] in both]
        seen = [one for one in shared if one.truth["strength"] in ("clear", "strong")]
        barely = [one for one in shared if one.truth["strength"] == "barely"]
        none = [one for one in shared if one.truth["kind"] == "none"]
        alarms = summary.rate(none, lambda one: one.answer.get("verdict") != "no_missing_effect")
        seconds = float(np.median([one.answer["wall_s"] for one in shared])) if shared else float("nan")
        named, wrong = summary.rate(seen, summary.is_right), summary.rate(barely, summary.is_wrong)
        lines.append(f"{who:18}  {named!s:32}  {wrong!s:32}  {alarms!s:32}  {seconds:.1f}")
    return "\n".join(lines)


def costs(scored: Sequence[Scored]) -> str:
    """Time and memory of the workflow."""
    spent = np.array([one.answer["wall_s"] for one in scored])
    memory = max(one.answer["peak_memory_MB"] for one in scored)
    return (
        f"{spent.size} cases: {np.median(spent):.1f} s a case in the median, {np.quantile(spent, 0.95):.1f} s at 95 %, "
        f"{spent.max():.1f} s at most (one thread each); {memory:.0f} MB at most"
    )


def write(root: Path, planned: int) -> str:
    """Score what is answered, write report.txt, report.json and confusion.png, and return the text.

    Raises:
        FileNotFoundError: nothing is answered yet.
    """
    scored = {who: summary.load(root, who) for who in ("workflow", "peer")}
    own = scored["workflow"]
    if not own:
        raise FileNotFoundError(f"{root / 'workflow'} has no answers")
    goals, confusion = summary.goals(own), summary.confusion(own)
    parts = [f"{len(own)} of {planned} cases answered", goal_table(goals), effect_table(summary.by_effect(own))]
    if confusion:
        parts.append("First names, clear and strong cases:\n" + confusion_text(confusion))
        confusion_figure(confusion, root / "confusion.png", "hapticd gap, clear and strong cases")
    parts.append(costs(own))
    if scored["peer"]:
        parts.append(peer_table(scored))
        confusion_figure(summary.confusion(scored["peer"]), root / "confusion_peer.png", "PySINDy, the same cases")
    text = "\n\n".join(parts) + "\n"
    write_atomically(root / "report.txt", text.encode())
    write_json(root / "report.json", _document(goals, confusion, own))
    return text


def _document(goals: Sequence[Goal], confusion: dict[str, Counter[str]], own: Sequence[Scored]) -> dict[str, Any]:
    return {
        "cases": len(own),
        "goals": [
            {
                "name": goal.name.strip(),
                "hits": goal.rate.hits,
                "of": goal.rate.of,
                "interval": list(goal.rate.interval),
                "wanted": f"{goal.bound} {goal.limit}",
                "reached": goal.reached,
            }
            for goal in goals
        ],
        "confusion": {row: dict(counts) for row, counts in confusion.items()},
        "to_look_at": json.loads(json.dumps(summary.wrong_cases(own))),
    }
