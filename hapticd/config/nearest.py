"""The valid name that is most similar to an invalid one."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def nearest_name(name: str, valid: Iterable[str]) -> str | None:
    """The closest of ``valid`` to ``name``, or None if none is similar."""
    names = {candidate.lower(): candidate for candidate in valid}
    close = difflib.get_close_matches(name.lower(), names, n=1, cutoff=0.6)
    return names[close[0]] if close else None


def nearest_key(key: str, valid: Iterable[str]) -> str | None:
    """The closest of the dotted keys ``valid`` to the dotted key ``key``.

    A misspelt key in the right section has priority, then the same word in another section, then a similar word in
    another section.
    """
    keys = list(valid)
    section, _, leaf = key.rpartition(".")
    siblings = {other.rpartition(".")[2]: other for other in keys if other.rpartition(".")[0] == section}
    if close := nearest_name(leaf, siblings):
        return siblings[close]
    if same := [other for other in keys if other.rpartition(".")[2] == leaf]:
        return same[0]
    elsewhere = {other.rpartition(".")[2]: other for other in keys}
    close = nearest_name(leaf, elsewhere)
    return elsewhere[close] if close else None
