"""The plant that was found, written into a config whose comments and order stay (ruamel.yaml's round trip)."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from hapticd.config import config_to_yaml, parse_yaml
from hapticd.config.presets import PRESETS, preset_names
from hapticd.config.reading import read_text
from hapticd.identify.result import UNCERTAIN, interval_digits
from hapticd.identify.workflow import REPLACED, effects_found, plant_section

if TYPE_CHECKING:
    from hapticd.config import Config
    from hapticd.gap.result import Estimate
    from hapticd.identify.result import Identified

_DIGITS = 6
_OWN_REMARKS = re.compile(r"^[ \t]*# (identified from|assumed:|standard deviations:).*\n", re.MULTILINE)
"""What an earlier identification wrote above its numbers."""
_WIDTH = 200
"""Correlations stay on one line."""


def text_of(source: str | None, model: Config) -> str:
    """The YAML text of a model: the file or preset it came from, or, where it came from a run, all of its keys.

    Raises:
        ConfigError: the file cannot be read.
    """
    if source is None:
        return config_to_yaml(model)
    if source in preset_names() and not Path(source).exists():
        return read_text(PRESETS / f"{source}.yaml", source)
    return read_text(Path(source), source)


def with_plant(text: str, result: Identified) -> str:
    """A config's text with the plant that was found; everything else, comments too, as it was.

    Args:
        text: YAML of a valid config.
        result: what was found.

    Raises:
        ConfigError: the new text is no valid config.
    """
    yaml = YAML()
    yaml.width = _WIDTH
    yaml.preserve_quotes = True
    data = yaml.load(_OWN_REMARKS.sub("", text))
    if data is None:
        data = CommentedMap()
    plant = _section(data, "plant")
    plant.fa.set_block_style()  # comments have no place in a flow mapping
    found: dict[str, Any] = plant_section(result)
    for name in ("inertia", "viscous", "coulomb"):
        plant[name] = _rounded(found[name])
        plant.yaml_add_eol_comment(_remark(getattr(result, name)), name)
    plant["effects"] = _effects(plant.get("effects"), result)
    uncertainty = CommentedMap({name: _rounded(found["uncertainty"][name]) for name in UNCERTAIN})
    uncertainty["correlation"] = CommentedMap(found["uncertainty"]["correlation"])
    uncertainty["correlation"].fa.set_flow_style()
    plant.pop("uncertainty", None)
    plant["uncertainty"] = uncertainty
    note = "\n".join(["identified from " + ", ".join(result.runs), *(f"assumed: {text}" for text in result.assumed)])
    plant.yaml_set_comment_before_after_key("uncertainty", before=f"{note}\nstandard deviations:", indent=2)
    if result.sign < 0:
        encoder = _section(data, "encoder")
        encoder["invert"] = not encoder.get("invert", False)
        encoder.yaml_add_eol_comment("identified: it counted against the torque", "invert")
    stream = io.StringIO()
    yaml.dump(data, stream)
    written = stream.getvalue()
    parse_yaml(written, "the identified config")
    return written


def _section(data: Any, name: str) -> Any:
    if data.get(name) is None:
        data[name] = CommentedMap()
    return data[name]


def _effects(present: Any, result: Identified) -> Any:
    """The effects of the model that are not replaced, as they stand, and what was found."""
    listed = present if present is not None else CommentedSeq()
    for index in reversed(range(len(listed))):
        if listed[index].get("name") in REPLACED:
            del listed[index]
    for effect in effects_found(result):
        entry = CommentedMap({key: _rounded(value) for key, value in effect.items()})
        entry.fa.set_flow_style()
        listed.append(entry)
        estimate = result.bias if effect["name"] == "constant_bias" else result.delay
        beyond = "" if effect["name"] == "constant_bias" else f"; beyond {result.declared_delay_s:.3g} s declared"
        listed.yaml_add_eol_comment(_remark(estimate) + beyond, len(listed) - 1)
    if len(listed) > 0:
        listed.fa.set_block_style()
    return listed


def _rounded(value: Any) -> Any:
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value


def _remark(estimate: Estimate) -> str:
    low, high = estimate.ci95
    digits = interval_digits(estimate)
    return f"{estimate.unit}, 95 %: {low:.{digits}g} to {high:.{digits}g}"
