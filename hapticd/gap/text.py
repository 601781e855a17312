"""Sentences about a result for the report and the command line.

They are made from the document of `gap.json`, so they are the same for a new result and for one read from a file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from hapticd.config.text import jitter
from hapticd.effects.catalogue import CATALOGUE
from hapticd.figures.style import prefixed
from hapticd.gap import constants

if TYPE_CHECKING:
    from hapticd.gap.result import GapResult

COORDINATES: Final = {
    "everywhere": ("N m", "N", "a constant torque"),
    "position": ("rad", "m", "a torque that depends on the position"),
    "velocity": ("rad/s", "m/s", "a torque that depends on the velocity"),
    "speed, against the motion": ("rad/s", "m/s", "friction that depends on the speed"),
    "current": ("A", "A", "a torque that depends on the current"),
    "time": ("s", "s", "a torque that drifts in time"),
    "time, against the motion": ("s", "s", "friction that drifts in time"),
    "way since a reversal, against the motion": ("rad", "m", "friction that builds up or fades after a reversal"),
    "position, against the motion": ("rad", "m", "friction that depends on the position"),
    "acceleration": ("rad/s²", "m/s²", "a torque that depends on the acceleration"),
    "change of the current": (
        "A/s",
        "A/s",
        "a torque that follows changes of the current, or a current filtered before it was recorded",
    ),
}
"""Coordinate of `where` and `remainder` to its rotary and linear unit, and a description of a force that depends on it."""
_LISTED: Final = 3


def is_linear(unit: str) -> bool:
    """Whether a gap in this unit is of a linear device."""
    return unit == "N"


def dependence_in_words(coordinate: str, *, linear: bool) -> str:
    """A missing force that depends on a coordinate, in words."""
    words = COORDINATES[coordinate][-1]
    return words.replace("torque", "force") if linear else words


def places(where: Sequence[Mapping[str, Any]], unit: str) -> list[str]:
    """The coordinates that explain most of the missing force, one clause each.

    Args:
        where: of `gap.json`. unit: of the gap.
    """
    listed = [entry for entry in where if entry["share"] >= constants.STRUCTURE_SHARE][:_LISTED]
    return [_place(entry, unit) for entry in listed]


def _place(entry: Mapping[str, Any], unit: str) -> str:
    name, linear = str(entry["coordinate"]), is_linear(unit)
    low, high = entry["range"]
    if name == "everywhere":
        return f"{percent(entry['share'])} is the same everywhere, {low:.3g} {unit}"
    words = dependence_in_words(name, linear=linear)
    return f"{percent(entry['share'])} as {words}, most of it from {low:.3g} to {high:.3g} {COORDINATES[name][linear]}"


def percent(share: float) -> str:
    """A share between 0 and 1 in percent, with two digits, at most two of them decimals."""
    value = 100.0 * share
    return f"{value:.0f} %" if value >= 9.95 else f"{value:.2g} %" if value >= 0.01 else "less than 0.01 %"


def chosen(step: Mapping[str, Any]) -> list[str]:
    """Parameters of an effect that were chosen and not fitted, such as the orders of a ripple; `step` of `gap.json`."""
    fitted = {name.partition("[")[0] for name in step["parameters"]}
    found = []
    for name, value in step["entry"].items():
        if name not in fitted:
            values = value if isinstance(value, list | tuple) else [value]
            found.append(f"{name} = {', '.join(f'{one:.4g}' for one in values)}")
    return found


def behind(step: Mapping[str, Any]) -> str:
    """How well the data distinguish an effect from other effects; `step` of `gap.json`."""
    effect = step["effect"]
    same = [other for other in step["indistinguishable_from"] if other in CATALOGUE[effect].equivalent_to]
    indistinguishable = [other for other in step["indistinguishable_from"] if other not in same]
    clauses = [f"{other} is the same law in other parameters" for other in same]
    if indistinguishable:
        return "; ".join([*clauses, f"these data do not distinguish it from {', '.join(indistinguishable)}"])
    others = sorted(
        (ranked for ranked in step["ranking"] if ranked["effect"] != effect), key=lambda ranked: float(ranked["behind"])
    )
    wider = [ranked["effect"] for ranked in others if ranked["behind"] < constants.INDISTINGUISHABLE]
    clauses += [f"{other}, of which it is a limit, predicts no better" for other in wider]
    rest = others[len(wider) :]
    if rest:
        clauses.append(f"the next best, {rest[0]['effect']}, is {rest[0]['behind']:.1f} standard errors behind")
    return "; ".join(clauses) or "no other effect comes near it"


def timing(document: Mapping[str, Any]) -> str:
    """How well the recordings are timed; `document` of `gap.json`."""
    recording, samples = document["recording"], document["details"].get("samples")
    missed, jitter_s = recording["missed"], float(recording["jitter_s"])
    of = f" of {samples + missed}" if samples else ""
    of_what = f"{missed}{of} sample{'' if missed == 1 and not of else 's'}"
    text = f"{of_what} missed, {jitter(jitter_s, recording.get('period_s'))}"
    if late := recording.get("current_late_s"):
        text = f"{text}, its current {1e3 * late['value']:.3g} ms late"
    if filtered := recording.get("current_filter_s"):
        text = f"{text}, its current filtered with {1e3 * filtered['value']:.3g} ms"
    return text


def predictions(document: Mapping[str, Any]) -> list[str]:
    """Prediction errors of both models from the command alone; `document` of `gap.json`."""
    return _errors(document["prediction"])


def validated(document: Mapping[str, Any]) -> list[str]:
    """Prediction errors on a recording that was not fitted, in one line; none without one. `document` of `gap.json`."""
    found = document["validation"]
    if not found:
        return []
    fits = found["free_run"]["fit_percent"]
    fit = "" if None in fits.values() else f" (fit {fits['before']:.4g} % before, {fits['after']:.4g} % after)"
    return [f"validated on {found['run']}, which was not fitted: {'; '.join(_errors(found))}{fit}. {found['words']}"]


def _errors(found: Mapping[str, Any]) -> list[str]:
    if not found:
        return []
    spans = ((f"{1e3 * found['horizon_s']:.3g} ms ahead", "k_step"), ("the whole record from its start", "free_run"))
    return [f"{span}: off by {_shrunk(found[key], found['unit'])}" for span, key in spans]


def _shrunk(error: Mapping[str, float], unit: str) -> str:
    before, after = (sized(error[when], unit) for when in ("before", "after"))
    return before if before == after else f"{before} before, {after} after"


def sized(value: float | None, unit: str) -> str:
    """A magnitude to three digits, in a unit with the prefix that suits it."""
    if value is None or not math.isfinite(value):
        return "too large to compute"
    factor, prefixed_unit = prefixed(value, unit) if value > 0.0 else (1.0, unit)
    return f"{value / factor:.3g} {prefixed_unit}"


def confidence(result: GapResult, known: int) -> str:
    """The evidence of the result, in sentences.

    Args:
        result: of the workflow. known: number of effects in the catalogue.
    """
    details = result.details
    tried = len(details.get("candidates", ()))
    which = "Every effect of the catalogue" if tried == known else f"{tried} of the catalogue's {known} effects"
    if details.get("is_quiet"):
        return "No effect was tried: the missing force is no more than the noise of the best device."
    if not result.steps and result.interrupted:
        return "The search was interrupted."
    if not result.steps:
        needed = details.get("needed_standard_errors")
        bar = f"{needed:.1f} standard errors that " if needed else "evidence that "
        return (
            f"{which} was tried; on held-out data none reaches the {bar}chance reaches in {percent(constants.LEVEL)} of "
            "recordings."
        )
    steps = result.to_json()["steps"]
    return " ".join(
        f"{step['effect']}: evidence of {step['evidence']:.1f} standard errors on held-out data; {behind(step)}."
        for step in steps
    )
