"""Limits of a configuration that are off: 0, -0 and null all mean no limit."""

from __future__ import annotations

from functools import reduce
from typing import TYPE_CHECKING

from hapticd.config.keys import extra_text, leaf_fields

if TYPE_CHECKING:
    from hapticd.config.model import Config


def limits_off(config: Config) -> list[str]:
    """Dotted keys of the limits on motor and motion that are off, in the order of the schema."""
    # An ideal quantity (no lag, no quantisation) is 0, a limit that is off is None.
    return [
        key
        for key, field in leaf_fields().items()
        if not key.startswith("record.")
        and extra_text(field, "zero_or_null")
        and reduce(getattr, key.split("."), config) is None
    ]


def limits_text(off: list[str]) -> str:
    """The end of a sentence about them."""
    return f"off, since 0 and null mean none: {', '.join(off)}"
