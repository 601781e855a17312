"""A module whose name begins with ``_`` is of use in its own package alone, and every other is used outside of it.

No test uses a private name: of a module, a function, a constant or a class that it imports.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
BY_NAME = ("hapticd.cli", "hapticd.effects", "hapticd.reproduce", "hapticd.export.plain")
"""Packages whose modules are looked up by name: commands, effects, figures, and what is copied into an exported model."""


def _name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


MODULES = {
    _name(path): path
    for package in ("hapticd", "drivers", "sim_hw")
    for path in sorted((ROOT / package).rglob("*.py"))
    if not path.name.startswith("__")
}


def _named(path: Path) -> Iterator[str]:
    """Modules that a file imports, or names in a string (``monkeypatch.setattr``, a table of modules)."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and "." in node.value:
            words = node.value.partition(":")[0].split(".")
            yield from (".".join(words[:n]) for n in range(2, len(words) + 1))


def _users() -> dict[str, set[Path]]:
    users = defaultdict(set)
    for folder in ("hapticd", "drivers", "sim_hw", "tests", "benchmarks", "docs"):
        for path in (ROOT / folder).rglob("*.py"):
            for name in _named(path):
                users[name].add(path)
    return users


USERS = _users()


def _outside(name: str) -> list[str]:
    """Files outside of a module's own package that use it."""
    return [str(path.relative_to(ROOT)) for path in USERS[name] if MODULES[name].parent not in path.parents]


def test_a_private_module_is_used_in_its_package_alone() -> None:
    private = [name for name, path in MODULES.items() if path.name.startswith("_")]
    assert len(private) > 50
    assert {name: found for name in private if (found := _outside(name))} == {}


def test_every_other_module_is_used_outside_of_its_package() -> None:
    def is_program(path: Path) -> bool:
        return '__name__ == "__main__"' in path.read_text()

    alone = [
        name
        for name, path in MODULES.items()
        if not (path.name.startswith("_") or name.startswith(BY_NAME) or is_program(path) or _outside(name))
    ]
    assert alone == []


def _is_private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__")


def _private_names(path: Path) -> Iterator[str]:
    """Private names of ours that a test imports, reads from what it imports, or replaces."""
    tree, imported = ast.parse(path.read_text()), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in (
            "hapticd",
            "drivers",
            "sim_hw",
        ):
            imported |= {alias.asname or alias.name for alias in node.names}
            yield from (alias.name for alias in node.names if _is_private(alias.name))
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(value=ast.Name(id=owner), attr=name) if owner in imported and _is_private(name):
                yield f"{owner}.{name}"
            case ast.Call(func=ast.Attribute(attr="setattr"), args=[ast.Name(), ast.Constant(value=str(name)), *_]) if (
                _is_private(name)
            ):
                yield name
            case ast.Constant(value=str(text)) if text.startswith(("hapticd.", "drivers.", "sim_hw.")):
                yield from (text for word in text.split(".") if _is_private(word))


def test_no_test_uses_a_private_name() -> None:
    used = {
        str(path.relative_to(ROOT)): found
        for path in (ROOT / "tests").rglob("*.py")
        if (found := [*_private_names(path)])
    }
    assert used == {}
