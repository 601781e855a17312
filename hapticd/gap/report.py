"""``report.html``: one self-contained page.

Its first screen says what is missing, where that is visible, with what evidence, and how far the gap shrank.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from jinja2 import Environment, PackageLoader, select_autoescape
from markupsafe import Markup

from hapticd.figures.markup import STYLE
from hapticd.figures.style import style
from hapticd.gap import text
from hapticd.gap.figures import all_figures
from hapticd.gap.next_step import next_step

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hapticd.effects.spec import Effect
    from hapticd.gap.recording import Recording
    from hapticd.gap.result import GapResult

HEADLINES: Final = {
    "effect_found": "Missing from the model: {effects}",
    "partly_explained": "Missing from the model: {effects}, and something that no effect explains",
    "no_missing_effect": "Nothing is missing from the model",
    "ambiguous": "Missing: {either}; these data do not distinguish which",
    "unexplained": "Something is missing that no effect explains",
}


def page(
    result: GapResult,
    recordings: Sequence[Recording],
    changes: Mapping[str, Any],
    catalogue: Mapping[str, Effect],
    changed: str,
) -> str:
    """The whole page.

    Args:
        result: of the workflow. recordings: that were fitted.
        changes: of :func:`hapticd.gap.consequences.consequences`.
        catalogue: slug to effect.
        changed: changed lines of the model, as a diff.
    """
    environment = Environment(
        loader=PackageLoader("hapticd.gap", "templates"),
        autoescape=select_autoescape(["html"]),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"g": _number, "percent": text.percent, "sized": text.sized}
    document = result.to_json()
    with style():
        figures = {name: _svg(figure) for name, figure in all_figures(result).items()}
    return environment.get_template("report.html").render(
        result=document,
        headline=headline(result),
        confidence=text.confidence(result, len(catalogue)),
        places=text.places(document["where"], result.gap.unit),
        predictions=text.predictions(document),
        timing=text.timing(document),
        next_step=next_step(document),
        chosen=text.chosen,
        behind=text.behind,
        recordings=recordings,
        changes=changes,
        catalogue=catalogue,
        changed=changed,
        figures=figures,
        style=Markup(STYLE),  # noqa: S704 - a constant of ours
        check_rows=_check_rows(changes),
    )


def headline(result: GapResult) -> str:
    """The verdict as a title."""
    effects = " and ".join(result.effects)
    if result.interrupted:
        return f"Interrupted; missing from the model, as far as the search went: {effects or 'nothing'}"
    either = " and ".join(" or ".join((step.effect, *step.indistinguishable_from)) for step in result.steps)
    return HEADLINES[result.verdict].format(effects=effects, either=either)


def _check_rows(changes: Mapping[str, Any]) -> list[tuple[str, Any, Any]]:
    before, after = changes["before"], changes["after"]
    keys = (("μ", "mu"), ("β", "beta"), ("σ", "sigma"), ("τ_D", "tau_d"), ("region", "region"))
    rows = [(label, before[key], after[key]) for label, key in keys]
    rows.append(("largest stiffness that dissipates", *(d["stiffness_max"]["dissipating"] for d in (before, after))))
    rows.append(("limit cycle, ticks", *(d["limit_cycle"]["amplitude_ticks"] for d in (before, after))))
    return rows


def _number(value: Any, digits: int = 4) -> str:
    if value is None:
        return "–"
    return f"{value:.{digits}g}" if isinstance(value, int | float) else str(value)


def _svg(figure: Figure) -> str:
    image = io.StringIO()
    figure.savefig(image, format="svg")
    return base64.b64encode(image.getvalue().encode()).decode()
