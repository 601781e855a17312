"""docs/code-overview.md names files and functions that exist."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs/code-overview.md").read_text()
ROOMS = ("hapticd", "drivers", "sim_hw", "tests", "benchmarks", "docs", "firmware")
FILES = {f"/{path.relative_to(ROOT)}" for room in ROOMS for path in (ROOT / room).rglob("*.*")}


def test_every_file_exists() -> None:
    named = set(re.findall(r"`([\w/]+\.(?:py|js|md|json))`", TEXT)) - {"_name.py", "gap.json"}
    assert len(named) > 100
    assert [name for name in sorted(named) if not any(path.endswith(f"/{name}") for path in FILES)] == []


def test_every_function_exists() -> None:
    """`gate.step_mode` is a function of a module called gate; a key such as `driver.reconnect` is of no module."""
    loop = {path.stem: path.read_text() for path in (ROOT / "hapticd/servo").glob("*.py")}
    named = {pair for pair in re.findall(r"`(\w+)\.(\w+)`", TEXT) if pair[1] != "py"}
    functions = {pair for pair in named if pair[0] in loop}
    assert len(functions) > 12
    assert [
        pair for pair in sorted(functions) if not re.search(rf"^def {pair[1]}\b", loop[pair[0]], re.MULTILINE)
    ] == []
    assert {
        pair for pair in named if f"_{pair[0]}" in loop
    } == set()  # a private module has its name with the underscore
