"""Strict reading of one YAML document: every irregularity is reported with its line.

YAML 1.1 as in PyYAML, with these differences: ``1e-3`` is a number; ``0660``, dates and ``1:30`` are text; a key that is
given twice is an error; only plain data, no tags.
"""

from __future__ import annotations

import re
from pathlib import Path

import yaml
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from hapticd.config.opening import open_regular
from hapticd.config.problems import ConfigError, Problem
from hapticd.config.text import shown

_MAX_BYTES = 1 << 18
_MAX_VALUES = 20_000  # nested aliases can multiply values beyond the machine's memory
_MAX_DEPTH = 50
_MAX_WHOLE = 1 << 1024  # what no floating-point number can be; Python does not even print one of 4301 digits
_PREFIX = "tag:yaml.org,2002:"
_FLOAT = r"[-+]?(?:[0-9][0-9_]*\.[0-9_]*|\.[0-9][0-9_]*|[0-9][0-9_]*(?=[eE]))(?:[eE][-+]?[0-9]+)?"
_RESOLVERS = (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"yes|Yes|YES|no|No|NO|true|True|TRUE|false|False|FALSE|on|On|ON|off|Off|OFF", list("yYnNtTfFoO")),
    ("int", r"[-+]?(?:0|[1-9][0-9_]*|0x[0-9a-fA-F_]+)", list("-+0123456789")),
    ("float", rf"(?:{_FLOAT}|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))", list("-+0123456789.")),
    ("merge", r"<<", ["<"]),
)


class _Loader(yaml.SafeLoader):
    """PyYAML's scanner, parser and scalar constructors with the number rules above."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012  (PyYAML's own class table)


for _name, _pattern, _first in _RESOLVERS:
    _Loader.add_implicit_resolver(_PREFIX + _name, re.compile(rf"(?:{_pattern})\Z"), _first)


def read_text(path: Path, name: str) -> str:
    """Read a configuration file as UTF-8 text.

    Raises:
        ConfigError: missing, a directory, unreadable, too large or not text.
    """
    try:
        with open_regular(path) as stream:
            data = stream.read(_MAX_BYTES + 1)
    except FileNotFoundError:
        raise _failure(name, "no such file") from None
    except IsADirectoryError:
        raise _failure(name, "is a directory, not a configuration file") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise _failure(name, f"cannot be read: {reason}") from None
    if len(data) > _MAX_BYTES:
        raise _failure(name, f"is larger than {_MAX_BYTES >> 10} KiB; this is not a configuration file")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise _failure(name, f"line {line}: not UTF-8 text (byte 0x{data[error.start]:02x})") from None


def read_yaml(text: str, name: str) -> tuple[object, list[Problem]]:
    """Parse one YAML document into plain Python data.

    Returns:
        The data (None for an empty document), and the problems after which validation can continue: keys given twice
        (the first one counts), keys that are not text, and tags.

    Raises:
        ConfigError: not YAML, or more than one document.
    """
    loader = None
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
        if node is None:
            return None, []
        converter = _Converter(loader, name)
        return converter.convert(node, "", ()), converter.problems
    except yaml.MarkedYAMLError as error:
        raise _failure(name, _syntax_message(error)) from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise _failure(name, f"line {line}: character U+{int(error.character):04X} is not allowed in YAML") from None
    except RecursionError:
        raise _failure(name, "is nested too deeply") from None
    finally:
        if loader is not None:
            loader.dispose()


class _Converter:
    """Converts nodes to plain data, with key path and line for messages."""

    def __init__(self, loader: _Loader, name: str) -> None:
        self.problems: list[Problem] = []
        self._values = 0
        self._loader = loader
        self._name = name

    def convert(self, node: Node, path: str, parents: tuple[Node, ...]) -> object:
        self._values += 1
        if self._values > _MAX_VALUES:
            raise _failure(self._name, f"holds more than {_MAX_VALUES} values; this is not a configuration file")
        if any(node is parent for parent in parents):
            self._note(path, "an alias that contains itself")
            return None
        if len(parents) > _MAX_DEPTH:
            raise _failure(self._name, "is nested too deeply")
        inside = (*parents, node)
        if isinstance(node, MappingNode):
            return self._mapping(node, path, inside)
        if isinstance(node, SequenceNode):
            return [self.convert(item, f"{path}[{index}]", inside) for index, item in enumerate(node.value)]
        return self._scalar(node, path)

    def _mapping(self, node: MappingNode, path: str, parents: tuple[Node, ...]) -> dict[str, object]:
        data: dict[str, object] = {}
        merged: dict[str, object] = {}
        lines: dict[str, int] = {}
        for key_node, value_node in node.value:
            line = key_node.start_mark.line + 1
            if not isinstance(key_node, ScalarNode):
                self._note(path, f"line {line}: a key must be a plain word")
                continue
            if key_node.tag == _PREFIX + "merge":
                self._merge(value_node, path, parents, merged)
                continue
            key = str(key_node.value)
            full = f"{path}.{key}" if path else key
            value = self.convert(value_node, full, parents)
            if key in lines:
                where = f"line {line}" if lines[key] == line else f"lines {lines[key]} and {line}"
                self._note(full, f"given twice, on {where}")
                continue
            lines[key] = line
            data[key] = value
        return {**merged, **data}

    def _merge(self, node: Node, path: str, parents: tuple[Node, ...], merged: dict[str, object]) -> None:
        value = self.convert(node, path, parents)
        sources = value if isinstance(value, list) else [value]
        for source in sources:
            if not isinstance(source, dict):
                self._note(path, f"line {node.start_mark.line + 1}: << needs a mapping")
                continue
            for key, item in source.items():
                merged.setdefault(key, item)

    def _scalar(self, node: Node, path: str) -> object:
        kind = str(node.tag).removeprefix(_PREFIX)
        try:
            if kind in ("null", "bool", "int", "float", "str"):
                value = self._loader.yaml_constructors[_PREFIX + kind](self._loader, node)
                if not isinstance(value, int) or abs(value) < _MAX_WHOLE:
                    return value
        except (ValueError, KeyError):
            pass
        self._note(path, f"line {node.start_mark.line + 1}: {shown(node.value)} cannot be read as {shown(kind)}")
        return None

    def _note(self, path: str, message: str) -> None:
        self.problems.append(Problem(self._name, path, None, message))


def _syntax_message(error: yaml.MarkedYAMLError) -> str:
    mark = error.problem_mark or error.context_mark
    where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
    problem = error.problem or error.context or "not valid YAML"
    if "'\\t'" in problem:
        return f"{where}a tab; YAML must be indented with spaces"
    if "single document" in str(error.context):
        return f"{where}a second document starts here; one file holds one configuration"
    if problem.startswith("mapping values are not allowed"):
        return f"{where}not valid YAML: a ':' where no key is expected; check the indentation of the lines above"
    context = f" {error.context}" if error.context and error.problem else ""
    return f"{where}not valid YAML{context}: {problem}"


def _failure(name: str, message: str) -> ConfigError:
    return ConfigError([Problem(name, "", None, message)])
