"""A model as a Python module that needs no hapticd: the source of `hapticd.export.plain`, and the model's numbers."""

from __future__ import annotations

import ast
import re
from dataclasses import fields
from importlib import resources
from typing import TYPE_CHECKING

from hapticd.export.axis_numbers import axis_numbers
from hapticd.export.plain.numbers import Numbers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hapticd.config import Config

_PARTS = ("numbers", "closed_form", "axis")


def module_text(config: Config, head: str, more: Sequence[str] = (), numbers: Numbers | None = None) -> str:
    """The module: classes ``Numbers`` and ``Axis``, the model as ``MODEL``, ``torque(x, v, i, t)`` and ``simulate``.

    Args:
        config: the model.
        head: its docstring: what it is and what is left out.
        more: modules of this package in place of the last two functions.
        numbers: other numbers than the config's.
    """
    imports: set[str] = set()
    model = f"MODEL = {numbers_text(numbers or axis_numbers(config))}\nPERIOD_S = {config.period!r}"
    bodies = []
    for name in (*_PARTS, "", *(more or ("functions",))):
        if not name:
            bodies.append(model)
            continue
        source = (resources.files("hapticd.export.plain") / f"{name}.py").read_text()
        found = [node for node in ast.parse(source).body if isinstance(node, ast.Import | ast.ImportFrom)]
        imports |= {text for node in found if "hapticd" not in (text := ast.unparse(node))}
        bodies.append("\n".join(source.splitlines()[found[-1].end_lineno or 0 :]).strip())
    future = "from __future__ import annotations"
    plain = sorted(imports - {future}, key=lambda line: (line.startswith("from"), line))
    return "\n".join([f'"""{head.strip()}\n"""', "", future, "", *plain, "", "", "\n\n\n".join(bodies), ""])


def numbers_text(numbers: Numbers) -> str:
    """The numbers as Python: those that are not neutral, a line each."""
    lines = []
    for field in fields(Numbers):
        value = getattr(numbers, field.name)
        if value != field.default:
            lines.append(f"    {field.name}={_literal(value)},")
    return "Numbers(\n" + "\n".join(lines) + "\n)"


def _literal(value: object) -> str:
    return re.sub(r"\binf\b", "math.inf", repr(value))
