"""What a refusal of the daemon leaves to choose, for the page: changes in the unit that was asked in."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from hapticd.config import LIVE_KEYS, Config, apply_settings
from hapticd.config.text import plain_number
from hapticd.config.units import in_unit, split
from hapticd.servo.sequence import Sequence, changed_step

_DIGITS = 3


def choice_for_page(choice: Mapping[str, Any]) -> dict[str, Any]:
    """The choice with, for each remedy, whether a button can bring it about: ``live``."""
    remedies = [{**each, "live": each["key"] in (*LIVE_KEYS, "deflection")} for each in choice.get("remedies") or ()]
    return {**choice, "remedies": remedies}


def in_asked_unit(choice: Mapping[str, Any], asked: Mapping[str, str], config: Config) -> dict[str, Any]:
    """The choice with a gentler release in the unit in which this one was asked for, on the safe side.

    Args:
        choice: of the refusal. asked: the deflection as it was typed, readable. config: in force.
    """
    number, unit = split(asked["text"])
    unit = unit or asked["unit"]
    ticks = in_unit("1", "ticks", config, bare=unit)

    def converted(remedy: dict[str, Any]) -> dict[str, Any]:
        if remedy["key"] != "deflection":
            return remedy
        after = math.copysign(_rounded_down(abs(remedy["after"] / ticks)), number)
        return {**remedy, "before": number, "after": after, "unit": unit}

    return {**choice, "remedies": [converted(each) for each in choice.get("remedies") or ()]}


def in_sequence(choice: Mapping[str, Any], text: str, sequence: Sequence, config: Config) -> dict[str, Any]:
    """The choice with, for each remedy of a step, the ``text`` of the sequence with it; a deflection is in the asked unit.

    Args:
        choice: of the refusal. text: of the sequence as it was asked for, readable. config: in force.
    """

    def written(remedy: dict[str, Any]) -> dict[str, Any]:
        if remedy["key"] == "spring.origin":  # no step has it: a release moves it
            return remedy
        settings, deflection, _ = sequence.steps[remedy["step"] - 1]
        its_own = apply_settings(config, settings, source=f"step {remedy['step']}")
        asked = {"text": str(deflection), "unit": "ticks"}
        (remedy,) = in_asked_unit({"remedies": [remedy]}, asked, its_own)["remedies"]
        bare = remedy["key"] != "deflection" or not split(asked["text"])[1]
        value = plain_number(remedy["after"]) if bare else f"{remedy['after']:g}{remedy['unit']}"
        return {**remedy, "text": changed_step(text, remedy["step"], remedy["key"], value)}

    return {**choice, "remedies": [written(each) for each in choice.get("remedies") or ()]}


def _rounded_down(size: float) -> float:
    if size == 0.0:
        return size
    power = 10.0 ** (_DIGITS - 1 - math.floor(math.log10(size)))
    # what was a number of few digits stays it, in spite of the way there and back
    return float(f"{math.floor(size * power * (1.0 + 1e-9)) / power:.{_DIGITS}g}")
