"""Edits values in the text of a config, and keeps its comments, order and spelling (round trip of ruamel.yaml)."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from hapticd.config._writing import config_to_yaml
from hapticd.config.loading import parse_yaml
from hapticd.config.model import Config
from hapticd.config.presets import PRESETS, preset_names
from hapticd.config.reading import read_text
from hapticd.config.text import yaml_value

_WIDTH: Final = 200
"""Line width, so large that lists of numbers stay on one line."""
_LISTED: Final = re.compile(r"^( *)effects:[^\n]*\n(?: *#[^\n]*\n)*( *)- ", re.MULTILINE)
"""Finds the indentation of list entries in a text."""


def text_of(source: str | None, model: Config) -> str:
    """The YAML text of a model: of its file or preset, or, if it is from a run, all keys except paths of the host.

    Raises:
        ConfigError: the file cannot be read.
    """
    if source is None:
        return config_to_yaml(model, without=("record", "api"))
    if source in preset_names() and not Path(source).exists():
        return read_text(PRESETS / f"{source}.yaml", source)
    return read_text(Path(source), source)


def _float(representer: Any, value: float) -> Any:
    return representer.represent_scalar("tag:yaml.org,2002:float", yaml_value(value))


class ConfigText:
    """The text of a valid config, to be edited.

    Attributes:
        data: the document as ruamel.yaml has it.
    """

    def __init__(self, text: str) -> None:
        self._yaml = YAML()
        self._yaml.width = _WIDTH
        self._yaml.preserve_quotes = True
        listed = _LISTED.search(text)
        offset = len(listed[2]) - len(listed[1]) if listed else 2
        self._yaml.indent(mapping=2, sequence=offset + 2, offset=offset)
        self._yaml.representer.add_representer(float, _float)
        self.data: Any = self._yaml.load(text)
        if self.data is None:
            self.data = CommentedMap()

    def section(self, name: str) -> Any:
        """A section, created if missing, in block style, because a flow mapping cannot have comments."""
        if self.data.get(name) is None:
            self.data[name] = CommentedMap()
        self.data[name].fa.set_block_style()
        return self.data[name]

    def put(self, section: str, key: str, value: object, remark: str = "") -> None:
        """Set a key, with a comment after it."""
        own = self.section(section)
        own[key] = value
        if remark:
            own.yaml_add_eol_comment(remark, key)

    def effects(self) -> Any:
        """The entries of ``plant.effects``, one per line."""
        plant = self.section("plant")
        if plant.get("effects") is None:
            plant["effects"] = CommentedSeq()
        plant["effects"].fa.set_block_style()
        return plant["effects"]

    @staticmethod
    def entry(values: Mapping[str, object]) -> Any:
        """An entry of ``plant.effects`` in one line."""
        made = CommentedMap(values)
        made.fa.set_flow_style()
        return made

    def text(self, source_name: str) -> str:
        """The edited text.

        Raises:
            ConfigError: it is not a valid config.
        """
        stream = io.StringIO()
        if "effects" in (self.data.get("plant") or {}) and not self.data["plant"]["effects"]:
            self.data["plant"]["effects"] = []
        self._yaml.dump(self.data, stream)
        written = stream.getvalue()
        parse_yaml(written, source_name)
        return written
