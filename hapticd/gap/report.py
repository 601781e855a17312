"""``report.html``: one self-contained page.

Its first screen says what is missing, where it shows, how sure that is, and how far the gap shrank.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from jinja2 import Environment, PackageLoader, select_autoescape
from markupsafe import Markup

from hapticd.effects.catalogue import CATALOGUE
from hapticd.gap.figures import all_figures
from hapticd.reproduce.markup import STYLE
from hapticd.reproduce.style import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hapticd.config import Config
    from hapticd.gap.data import Recording
    from hapticd.gap.result import GapResult

HEADLINES: Final = {
    "effect_found": "Missing from the model: {effects}",
    "no_missing_effect": "Nothing is missing from the model",
    "ambiguous": "Missing: {either}; these data leave open which",
    "unexplained": "Something is missing that has no name here",
}


def page(
    result: GapResult,
    recordings: Sequence[Recording],
    model: Config,
    changes: Mapping[str, Any],
    catalogue: Mapping[str, str],
    improved: str,
) -> str:
    """The whole page.

    Args:
        result: what was found. recordings: in what. model: the model as given.
        changes: of :func:`hapticd.gap.consequences.consequences`.
        catalogue: slug to what the effect is, in a sentence.
        improved: the improved model as YAML.
    """
    environment = Environment(
        loader=PackageLoader("hapticd.gap", "templates"),
        autoescape=select_autoescape(["html"]),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"g": _number, "percent": lambda share: f"{100.0 * max(share, 0.0):.1f} %"}
    with style():
        figures = {name: _svg(figure) for name, figure in all_figures(result, model.is_linear).items()}
    return environment.get_template("report.html").render(
        result=result,
        headline=headline(result),
        confidence=confidence(result),
        recordings=recordings,
        changes=changes,
        catalogue=catalogue,
        improved=improved,
        figures=figures,
        style=Markup(STYLE),
        check_rows=_check_rows(changes),
    )


def headline(result: GapResult) -> str:
    """The verdict as a title."""
    effects = " and ".join(result.effects)
    if result.verdict == "unexplained" and result.effects:
        return f"{HEADLINES['unexplained']}, beside {effects}"
    either = " and ".join(" or ".join((step.effect, *step.indistinguishable_from)) for step in result.steps)
    return HEADLINES[result.verdict].format(effects=effects, either=either)


def confidence(result: GapResult) -> str:
    """How sure, in words."""
    tried = len(result.details.get("candidates", CATALOGUE))
    which = (
        "Every effect of the catalogue"
        if tried == len(CATALOGUE)
        else f"{tried} of the catalogue's {len(CATALOGUE)} effects"
    )
    if not result.steps:
        return f"{which} was tried on windows that it was not fitted to; none helps more than chance does in 0.5 % of runs."
    sentences = []
    for step in result.steps:
        other = (
            f"; these data do not tell it from {', '.join(step.indistinguishable_from)}"
            if step.indistinguishable_from
            else "; every other effect tried predicts significantly worse"
        )
        sentences.append(f"{step.effect}: {step.evidence:.1f} standard errors of held-out evidence{other}.")
    return " ".join(sentences)


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
