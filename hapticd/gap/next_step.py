"""What to do next, in one or two sentences, for each verdict."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from hapticd.gap.text import COORDINATES

if TYPE_CHECKING:
    from collections.abc import Mapping

_MOTION: Final = {
    "everywhere": "goes both ways alike",
    "position": "covers more positions",
    "velocity": "goes both ways at many speeds",
    "speed, against the motion": "goes both ways at many speeds",
    "current": "takes small and large currents",
    "time": "lasts longer, from a cold start",
    "time, against the motion": "lasts longer, from a cold start",
    "way since a reversal, against the motion": "reverses often, after short and long distances",
    "position, against the motion": "covers more positions in both directions",
    "acceleration": "accelerates harder, as a chirp does",
    "change of the current": "has steps of the current, recorded as it was commanded",
}
"""Coordinate to a motion in which it varies more."""
assert _MOTION.keys() == COORDINATES.keys()


def next_step(document: Mapping[str, Any]) -> str:
    """What to do after a result; `document` of `gap.json`."""
    verdict = document["verdict"]
    if document["interrupted"]:
        return "Let the search run to its end: it may find more missing effects."
    if verdict == "ambiguous":
        planned = document["next_experiment"]
        return str(planned["words"]) if planned else _record("goes faster, slower and both ways")
    if verdict == "no_missing_effect":
        return "Keep the model for motions like these. A faster and larger motion would be a stronger test (hapticd excite)."
    shown = [*document["remainder"]["structure"], *document["where"]]
    more = _record(_MOTION[shown[0]["coordinate"]] if shown else "has slow ramps, steps and a chirp")
    if verdict == "unexplained":
        return f"{more} A law of your own can be added to the catalogue (docs/effects/README.md)."
    tested = document["validation"]
    if tested and tested["verdict"] in ("worse", "mixed") and tested["k_step"]["after"] > tested["k_step"]["before"]:
        return f"Fit the recordings and {tested['run']} together, and check whether the same effects are named."
    if verdict == "partly_explained":
        return f"Use model.yaml for motions like these. {more}"
    if not tested:
        return "Test it on a recording of another motion (hapticd gap RUN… --validate RUN), then use model.yaml."
    return "Use model.yaml: hapticd run, simulate and check take it."


def _record(motion: str) -> str:
    return f"Record a motion that {motion} (hapticd excite), and run hapticd gap on all recordings together."
