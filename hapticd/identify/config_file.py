"""Writes the identified plant into a config, and keeps its comments and order (round trip of ruamel.yaml)."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ruamel.yaml.comments import CommentedMap

from hapticd.config.editing import ConfigText
from hapticd.figures.files import refuse_existing
from hapticd.identify.result import UNCERTAIN, interval_digits
from hapticd.identify.workflow import REPLACED, effects_found, plant_section

if TYPE_CHECKING:
    from hapticd.gap.result import Estimate
    from hapticd.identify.result import Identified

_DIGITS = 6
_OWN_REMARKS = re.compile(r"^[ \t]*# (identified from|assumed:|standard deviations:).*\n", re.MULTILINE)
"""Comments of an earlier identification."""


def refuse_another(out: Path, model: str | None, read: Iterable[Path], *, force: bool) -> None:
    """Refuse to overwrite a file, except the model's own, which is updated.

    Args:
        out: file to write. model: the given config, a file or a preset. read: the recordings.

    Raises:
        FileExistsError: it exists, is not the model, and ``force`` is not given; or it is a recording.
    """
    for recording in read:
        refuse_existing(out, force=True, source=recording)
    updated = model is not None and out.exists() and Path(model).exists() and out.samefile(model)
    try:
        refuse_existing(out, force=force or updated)
    except FileExistsError as error:
        raise FileExistsError(f"{error}, or update it with --model {out}") from None


def with_plant(text: str, result: Identified) -> str:
    """The text of a config with the identified plant; all else, comments included, is unchanged.

    Args:
        text: YAML of a valid config.
        result: the identification.

    Raises:
        ConfigError: the new text is not a valid config.
    """
    written = ConfigText(_OWN_REMARKS.sub("", text))
    plant = written.section("plant")
    found: dict[str, Any] = plant_section(result)
    for name in ("inertia", "viscous", "coulomb"):
        written.put("plant", name, _rounded(found[name]), _remark(getattr(result, name)))
    _put_effects(written, result)
    uncertainty = CommentedMap({name: _rounded(found["uncertainty"][name]) for name in UNCERTAIN})
    uncertainty["correlation"] = CommentedMap(found["uncertainty"]["correlation"])
    uncertainty["correlation"].fa.set_flow_style()
    plant.pop("uncertainty", None)
    plant["uncertainty"] = uncertainty
    note = "\n".join(["identified from " + ", ".join(result.runs), *(f"assumed: {text}" for text in result.assumed)])
    plant.yaml_set_comment_before_after_key("uncertainty", before=f"{note}\nstandard deviations:", indent=2)
    if result.sign < 0:
        encoder = written.section("encoder")
        written.put("encoder", "invert", not encoder.get("invert", False), "identified: it counted against the torque")
    return written.text("the identified config")


def _put_effects(written: ConfigText, result: Identified) -> None:
    """Keep the effects of the model that are not replaced, and add the identified ones."""
    listed = written.effects()
    for index in reversed(range(len(listed))):
        if listed[index].get("name") in REPLACED:
            del listed[index]
    for effect in effects_found(result):
        listed.append(written.entry({key: _rounded(value) for key, value in effect.items()}))
        estimate = result.bias if effect["name"] == "constant_bias" else result.delay
        beyond = "" if effect["name"] == "constant_bias" else f"; beyond {result.declared_delay_s:.3g} s declared"
        listed.yaml_add_eol_comment(_remark(estimate) + beyond, len(listed) - 1)


def _rounded(value: Any) -> Any:
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value


def _remark(estimate: Estimate) -> str:
    low, high = estimate.ci95
    digits = interval_digits(estimate)
    return f"{estimate.unit}, 95 %: {low:.{digits}g} to {high:.{digits}g}"
