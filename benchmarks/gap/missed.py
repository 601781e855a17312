"""``python -m benchmarks.gap.missed -o results/gap --seed 100:200``: could the hidden effects that were not named be known?

Every answered case that lacks a hidden name is fitted from its truth on, all hidden effects together. For each of them are
printed the standard errors by which the whole model is better than the one without it, and the share of the missing force's
power that it closes; first beside the disturbance that effects are looked for with, then beside one that may be slow.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.gap import options, plan, score, summary, tasks
from benchmarks.gap.cases import Files, write_files
from benchmarks.gap.collect import Store
from benchmarks.gap.summary import Scored
from benchmarks.report import progress

_STEPS = 40
_KINDS = ("single", "pair", "wrong_base")


class Known(NamedTuple):
    """How well one hidden effect shows, fitted from the truth on."""

    slug: str
    errors: float
    closed: float
    errors_beside_slow: float
    closed_beside_slow: float


class Missed(NamedTuple):
    """One case that lacks a name."""

    one: Scored
    effects: list[Known]
    needed: float
    """Standard errors that a name needs."""


def is_missed(one: Scored) -> bool:
    """Whether an answer lacks the name of a hidden effect."""
    slugs = one.truth["slugs"]
    return not (summary.is_named(one) if len(slugs) == 1 else summary.are_all_named(one))


def known(files: Files, effects: Sequence[dict[str, Any]]) -> tuple[list[Known], float]:
    """How well each hidden effect of a case shows, and the standard errors that a name needs."""
    from hapticd.effects.catalogue import EFFECT_SLUGS
    from hapticd.gap.base_model import problem_of
    from hapticd.gap.law_set import LawSet, evidence, scored
    from hapticd.gap.missing import missing_power
    from hapticd.gap.nominal import nominal_fit
    from hapticd.gap.sets import needed_errors
    from hapticd.gap.terms import term

    with tempfile.TemporaryDirectory(prefix="gap-") as folder:
        write_files(Path(folder), files)
        recording, model = tasks.loaded(Path(folder))
    nominal = nominal_fit(problem_of([recording], model))
    fit = nominal
    for effect in effects:
        values = {name: value for name, value in effect.items() if name != "name"}
        held = ("orders",) if "orders" in values else ()
        fit = fit.extended(term(effect["name"], values, held, 0.1 * float(abs(recording.position).max())))
    fit.scan_power()
    whole = scored(fit.maximise(_STEPS))
    found = []
    for number, effect in enumerate(effects):
        reduced = fit.without(number, nominal.noise)
        less = scored(reduced.maximise(_STEPS))

        def shows(more: LawSet, less: LawSet) -> tuple[float, float]:
            return evidence(more, less)[1], 1.0 - missing_power(more.fit) / missing_power(less.fit)

        found.append(
            Known(effect["name"], *shows(whole, less), *shows(whole.with_slow_disturbance, less.with_slow_disturbance))
        )
    return found, needed_errors(whole.held_out.size, len(EFFECT_SLUGS))


def row(missed: Missed) -> list[list[str]]:
    """A line for each hidden effect."""
    truth, answer = missed.one
    coloured = truth["coloured"]
    beside = f"{coloured['share']:.0%}, {1e3 * coloured['correlation_s']:.0f} ms" if coloured else ""
    strengths = [*truth["strengths"], *[None] * (len(truth["slugs"]) - len(truth["strengths"]))]
    names = ", ".join(score.names_of(answer))
    return [
        [
            f"{truth['seed']}.{truth['number']}",
            effect.slug,
            "" if strength is None else f"{strength:.2f}",
            beside,
            f"{score.verdict_of(answer)}: {names}" if names else score.verdict_of(answer),
            f"{effect.errors:.1f}",
            f"{effect.closed:.1%}",
            f"{effect.errors_beside_slow:.1f}",
            f"{effect.closed_beside_slow:.1%}",
            "" if effect.errors_beside_slow > missed.needed else "cannot be known",
        ]
        for effect, strength in zip(missed.effects, strengths, strict=True)
    ]


def main() -> int:
    """Fit and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap.missed", description=__doc__.split("\n\n")[1])
    options.add_common(parser, Path(__file__).parent.parent / "results/gap")
    parser.add_argument(
        "--seed", type=options.seeds, default=range(100), metavar="A:B", help="seeds of the cases, as 0:20"
    )
    parser.add_argument("--kind", action="append", choices=_KINDS, help="repeatable; default: all")
    chosen = parser.parse_args()
    options.check(parser, chosen)
    store = Store(chosen.output)
    cases = {case.name: case for case in plan.draw(plan.FULL, chosen.seed) if case.kind in (chosen.kind or _KINDS)}
    missed = [one for one in summary.load(chosen.output, "workflow", cases.values()) if is_missed(one)]
    lines = []
    with options.engine(chosen) as pool:
        files = [store.files(cases[one.truth["name"]]) for one in missed]
        answers = pool.map(known, files, [one.truth["effects"] for one in missed])
        for done, (one, (effects, needed)) in enumerate(zip(missed, answers, strict=True), 1):
            lines += row(Missed(one, effects, needed))
            progress(f"{done} of {len(missed)} cases")
    head = ["case", "hidden", "strength", "beside", "answer", "errors", "closed", "errors, slow", "closed, slow", ""]
    print(options.table(head, lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
