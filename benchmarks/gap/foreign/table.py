"""The report: by machine, friction, fault and config; the two rates; the cost; slow drives' inertia; what to look at."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.gap import options
from benchmarks.gap.cases import write_atomically, write_json
from benchmarks.gap.foreign import judge
from benchmarks.gap.foreign.cases import Case
from benchmarks.gap.rate import Rate

WHO = "workflow"
GOOD_GOAL, WRONG_GOAL, INERTIA_GOAL = 0.95, 0.02, 0.05
_SPLITS = ("machine", "friction", "fault", "config")
_SLOW = "slow_drive"


class Scored(NamedTuple):
    """One case with its answer."""

    name: str
    truth: dict[str, Any]
    answer: dict[str, Any]

    @property
    def outcome(self) -> str:
        """One of `judge.OUTCOMES`."""
        return judge.outcome(self.truth, self.answer)


def load(root: Path, cases: Sequence[Case]) -> list[Scored]:
    """The answered ones: here the truth is opened."""
    found = []
    for case in cases:
        path = root / WHO / f"{case.name}.json"
        if path.exists():
            truth = json.loads((root / "truth" / f"{case.name}.json").read_text())
            found.append(Scored(case.name, truth, json.loads(path.read_text())))
    return found


def rate(scored: Sequence[Scored], *outcomes: str) -> Rate:
    """How many are one of these."""
    return Rate(sum(one.outcome in outcomes for one in scored), len(scored))


def by(scored: Sequence[Scored], key: str) -> str:
    """Counts of every outcome, by one key of the truth."""
    values = list(dict.fromkeys(one.truth[key] for one in scored))
    lines = []
    for value in sorted(values):
        cell = [one for one in scored if one.truth[key] == value]
        counts = Counter(one.outcome for one in cell)
        lines.append([value, str(len(cell)), *(str(counts[name] or "·") for name in judge.OUTCOMES)])
    return options.table([key, "cases", *judge.OUTCOMES], lines)


def inertia(scored: Sequence[Scored]) -> str:
    """How near the inertia comes, machine by machine; that of slow drives one by one."""
    errors = {one.name: judge.inertia_error(one.truth, one.answer) for one in scored if "error" not in one.answer}
    lines, listed = [], []
    for machine in dict.fromkeys(one.truth["machine"] for one in scored):
        own = [(one.name, errors[one.name]) for one in scored if one.truth["machine"] == machine and one.name in errors]
        within = Rate(sum(abs(error) <= INERTIA_GOAL for _, error in own), len(own))
        lines.append([machine, str(within), f"{100 * max((abs(error) for _, error in own), default=0.0):.0f} %"])
        if machine == _SLOW:
            listed = [f"{name} {100 * error:+.1f} %" for name, error in own]
    head = ["machine", f"inertia within {100 * INERTIA_GOAL:g} %", "farthest off"]
    return f"{options.table(head, lines)}\n{_SLOW}: {', '.join(listed)}"


def cost(scored: Sequence[Scored]) -> str:
    """Runs of the filter, and seconds."""
    runs = [one.answer["details"]["filter_runs"] for one in scored if "error" not in one.answer]
    spent = [one.answer["processor_s"] for one in scored]
    if not runs:
        return "no answers"
    return (
        f"runs of the filter: {np.mean(runs):.0f} in the mean, {max(runs)} at most; "
        f"processor: {np.mean(spent):.1f} s in the mean, {max(spent):.1f} s at most"
    )


def to_look_at(scored: Sequence[Scored]) -> list[dict[str, Any]]:
    """What is neither right nor abstains, in numbers that help to see why."""
    listed = []
    for one in scored:
        truth, answer = one.truth, one.answer
        if one.outcome in judge.GOOD:
            continue
        kept = ("machine", "friction", "fault", "config", "rate_hz", "rows", "right", "near", "true", "said")
        shares = {key: round(truth[key], 3) for key in ("config_lacks", "base_lacks", "inertial")}
        entry = {"case": one.name, "outcome": one.outcome, **{key: truth[key] for key in kept}, **shares}
        if "error" in answer:
            listed.append(entry | {"error": answer["error"].strip().splitlines()[-1]})
            continue
        names = {name: judge.of_name(truth, answer, name) for name in answer["effects"]}
        parameters = {
            step["effect"]: {key: f"{value['value']:.3g}" for key, value in step["parameters"].items()}
            | {"errors": round(step["evidence"], 1), "share": round(step["share"], 3)}
            for step in answer["steps"]
        }
        gap = {"gap": answer["gap"], "inertia_off": round(judge.inertia_error(truth, answer), 3)}
        said = {"verdict": answer["verdict"], "names": names, "steps": parameters, "statement": answer["statement"]}
        listed.append(entry | said | gap | {"warnings": answer["warnings"]})
    return listed


def write(root: Path, cases: Sequence[Case]) -> str:
    """Write report.txt and report.json, and return the text.

    Raises:
        FileNotFoundError: nothing is answered yet.
    """
    scored = load(root, cases)
    if not scored:
        raise FileNotFoundError(f"{root / WHO} has no answers to these cases")
    good, wrong = rate(scored, *judge.GOOD), rate(scored, "wrong")
    parts = [
        f"{len(scored)} of {len(cases)} cases answered",
        *(by(scored, key) for key in _SPLITS),
        f"right or abstains {good}, wanted ≥ {100 * GOOD_GOAL:g} %\n"
        f"confidently wrong {wrong}, wanted ≤ {100 * WRONG_GOAL:g} %",
        inertia(scored),
        cost(scored),
    ]
    text = "\n\n".join(parts) + "\n"
    write_atomically(root / "report.txt", text.encode())
    rates = {"good": [good.hits, good.of, *good.interval], "wrong": [wrong.hits, wrong.of, *wrong.interval]}
    write_json(root / "report.json", {**rates, "to_look_at": to_look_at(scored)})
    return text
