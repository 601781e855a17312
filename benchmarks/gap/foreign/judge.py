"""What an answer is, by the rules at the head of the package."""

from __future__ import annotations

import math
from typing import Any

Answer = dict[str, Any]
Truth = dict[str, Any]

OUTCOMES = ("right", "abstains", "missed", "doubted", "wrong", "failed")
"""From good to bad; the worst name counts."""
GOOD = ("right", "abstains")
BASE = {"inertia_error": "inertia", "viscous_friction": "viscous", "coulomb_friction": "coulomb"}
_FACTOR = "torque_constant_error"
_NEAR = {"inertia": 0.1, "viscous": 0.2, "coulomb": 0.2}
_MISSED = 0.1
"""Of the motor's torque; more is something that is missing."""
_OTHER_INERTIA = math.log(1.2)
"""An inertia so far off is not right, whatever is named."""
_ABOUT_ALL = "The named effects depend on that"
_ABOUT_BASE = "Neither is sure"


def outcome(truth: Truth, answer: Answer) -> str:
    """One of `OUTCOMES`."""
    if "error" in answer:
        return "failed"
    if not answer["effects"]:
        is_silent = answer["verdict"] == "no_missing_effect" and truth["config_lacks"] > _MISSED
        return "missed" if is_silent else "right" if answer["verdict"] == "no_missing_effect" else "abstains"
    worst = max((of_name(truth, answer, name) for name in answer["effects"]), key=OUTCOMES.index)
    if worst == "right" and abs(math.log1p(inertia_error(truth, answer))) > _OTHER_INERTIA:
        return "missed" if answer["verdict"] == "effect_found" else "abstains"
    return worst


def of_name(truth: Truth, answer: Answer, name: str) -> str:
    """What one name is: right, abstains, doubted or wrong."""
    what, ties = kind(truth, answer, name), _ties(answer, name)
    if what == "right":
        return "right"
    if any(kind(truth, answer, tie) == "right" for tie in ties):
        return "abstains"
    is_doubted = bool(ties) or _has_doubt(answer, name)
    if what == "near":
        return "abstains" if is_doubted else "wrong"
    return "doubted" if is_doubted else "wrong"


def kind(truth: Truth, answer: Answer, name: str) -> str:
    """Whether a name is right, near or wrong, its numbers considered."""
    if name in (*BASE, _FACTOR):
        return "right" if _base_is_right(truth, answer, name) else "wrong"
    values = _values(answer, name)
    if name in truth["right"]:
        sign, size = truth["signs"].get(name), values.get("d", values.get("s"))
        if sign and size is not None and size * sign < 0.0:
            return "near" if truth["friction"] == "stribeck" else "wrong"
        if name == "torque_ripple":
            return "right" if _is_of_order(truth, values) else "wrong"
        return "right"
    if name == "torque_ripple" and name in truth["near"]:  # order 1 is gravity
        return "right" if _is_of_order(truth, values) else "wrong"
    return "near" if name in truth["near"] else "wrong"


def inertia_error(truth: Truth, answer: Answer) -> float:
    """Relative error of the inertia, as fitted where it is named, else the config's."""
    return _fitted(answer, truth, "inertia") / truth["true"]["inertia"] - 1.0


def _is_of_order(truth: Truth, values: dict[str, float]) -> bool:
    found = [value for key, value in values.items() if key.startswith("orders")]
    return not found or any(abs(one - order) < 0.05 + 0.02 * order for one in found for order in truth["orders"])


def _base_is_right(truth: Truth, answer: Answer, name: str) -> bool:
    if name == _FACTOR:
        return all(_is_nearer(truth, answer, of) for of in ("inertia",) if truth["friction_is_free"]) and (
            truth["friction_is_free"] or all(_is_nearer(truth, answer, of) for of in BASE.values())
        )
    return (truth["friction_is_free"] and name != "inertia_error") or _is_nearer(truth, answer, BASE[name])


def _is_nearer(truth: Truth, answer: Answer, of: str) -> bool:
    true, said, found = truth["true"][of], truth["said"][of], _fitted(answer, truth, of)
    if min(true, said, found) <= 0.0:
        return abs(found - true) <= _NEAR[of] * max(true, said)
    way = abs(math.log(said / true))
    return abs(math.log(found / true)) <= max(math.log1p(_NEAR[of]), 0.5 * way)


def _fitted(answer: Answer, truth: Truth, of: str) -> float:
    factor = 1.0 + _values(answer, _FACTOR).get("r", 0.0)
    value = float(answer["base"][of]["value"]) if of in answer["base"] else float(truth["said"][of])
    return value / factor


def _values(answer: Answer, name: str) -> dict[str, float]:
    steps = [step for step in answer["steps"] if step["effect"] == name]
    return {key: one["value"] for step in steps for key, one in step["parameters"].items()}


def _ties(answer: Answer, name: str) -> list[str]:
    return [tie for step in answer["steps"] if step["effect"] == name for tie in step["indistinguishable_from"]]


def _has_doubt(answer: Answer, name: str) -> bool:
    details = answer["details"]
    if name in details["at_bounds"] or name in details["predicted_better_by"] or _ABOUT_ALL in answer["statement"]:
        return True
    return name in (*BASE, _FACTOR) and _ABOUT_BASE in answer["statement"]
