"""A refusal that leaves a choice, in the words of whoever passes it on: the API, a command with its options."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from hapticd.config.text import change_line


def refusal_text(choice: Mapping[str, Any], named: Callable[[str], str | None]) -> str:
    """Why, what is enough to change, and how to have it all the same.

    Args:
        choice: ``reason``, ``remedies``, ``help`` and ``force``, as `hapticd.control.schemas.ErrorDetail`.
        named: what ``deflection``, ``force`` and the keys of settings are called where the request was made; None: it has
            no such thing.
    """
    lines = [choice["reason"]]
    if remedies := choice.get("remedies"):
        lines.append("One of these changes is enough:")
        lines += [change_line(named(each["key"]) or each["key"], each) for each in remedies]
    elif choice.get("help"):
        lines.append(choice["help"])
    if choice.get("force") and (force := named("force")):
        lines.append(f"Render it all the same: {force}")
    return "\n".join(lines)
