"""Whether the loop meets its rate: one rule for the daemon's status and for ``hapticd latency``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from hapticd.config.text import significant

MARGIN: Final = 0.5
"""Largest fraction of a period for lateness plus execution at p99.9, for a recommended rate."""


def used_fraction(timing: Mapping[str, Any], rate_hz: float) -> float | None:
    """Fraction of a period for lateness plus execution at p99.9; None if nothing was counted.

    Args:
        timing: with ``wake_us`` and ``exec_us``. rate_hz: the servo rate.
    """
    wake, execution = timing["wake_us"]["p999"], timing["exec_us"]["p999"]
    return None if wake is None or execution is None else (wake + execution) * 1e-6 * rate_hz


def verdict(timing: Mapping[str, Any], rate_hz: float) -> str:
    """Whether the loop meets its rate, in words.

    Args:
        timing: as for `used_fraction`, with ``missed`` and ``exchanges_missed``. rate_hz: the servo rate.
    """
    used = used_fraction(timing, rate_hz)
    if used is None:
        return "no tick yet"
    missed = [
        f"{count} {name}{'' if count == 1 else 's'} missed"
        for name, count in (("period", timing["missed"]), ("exchange", timing["exchanges_missed"]))
        if count
    ]
    taken = f"lateness and execution take {significant(100 * used, 2)} % of a period at p99.9"
    if missed:
        return f"does not keep up: {' and '.join(missed)}; {taken}"
    if used > MARGIN:
        return f"keeps up without margin: {taken}, more than {100 * MARGIN:.0f} %"
    return f"keeps up: {taken}"
