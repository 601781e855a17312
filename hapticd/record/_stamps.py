"""Time stamps of a foreign file as seconds: numbers, counters that start again, instants and times of day in text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.config.text import decimal_comma
from hapticd.config.units import TIME_UNITS, spelled
from hapticd.record._importing_sources import Source, refuse_missing
from hapticd.record.errors import RunFileError
from hapticd.record.importing_map import Reference, Time

FloatArray = NDArray[np.float64]

_LASTED: Final = re.compile(r"([-+]?[\d.]+(?:e[-+]?\d+)?)\s*([a-zµ]+)")
"""A time with its unit, as MATLAB writes a timetable's: 0.001 sec."""
_OF_DAY: Final = re.compile(r"(\d{1,3}):(\d{2}):(\d{2}(?:[.,]\d+)?)")
_DAY_S: Final = 86400.0
_COUNTERS: Final = tuple((bits, scale) for scale in (1.0, 1e-3, 1e-6, 1e3) for bits in (16, 24, 31, 32))
_NEAR: Final = 1e-3


def read_stamps(source: Source, time: Time, reference: Reference) -> tuple[FloatArray, float, list[str]]:
    """Stamps in s; the stamp that was taken off them, in the file's unit; and what a reader should know.

    Raises:
        RunFileError: they are no stamps, not finite, fall as a counter does that starts again, or end before they begin.
    """
    stamps = source.column(reference, "time.column")
    where = f"{source.path}: time.column = {reference}"
    notes: list[str] = []
    unit = 1.0
    if stamps.dtype.kind in "Mm" or (stamps.dtype.kind in "OU" and decimal_comma(stamps[0]) is None):
        if time.unit != "s":
            raise RunFileError(f"{where}: time.unit = {time.unit}, but the stamps are instants, which need no unit")
        stamps, unit, notes = _instants(stamps, where)
    else:
        stamps = source.numbers(reference, "time.column")
        unit = TIME_UNITS[time.unit]
    origin = 0.0
    if stamps.dtype.kind == "i":
        # Nanoseconds since 1970 do not fit into a double; their differences do.
        origin = float(stamps[0])
        stamps = stamps - stamps[0]
    values = np.asarray(stamps, dtype=np.float64)
    refuse_missing(where, values)
    if time.wrap is not None:
        raw, values = values, np.unwrap(values, period=time.wrap)
        if np.array_equal(raw, values):
            notes.append(f"time.wrap = {time.wrap:g} {time.unit} never acts: no stamp falls by more than half of it")
    _refuse_falls(values, time, where)
    return values if unit == 1.0 else values * unit, origin, notes


def _instants(stamps: NDArray[Any], where: str) -> tuple[NDArray[Any], float, list[str]]:
    """Whole nanoseconds, or seconds of the day; the unit in s; what is to be known of them."""
    if stamps.dtype.kind in "Mm":
        refuse_missing(where, stamps)
        return stamps.astype(f"{stamps.dtype.kind}8[ns]").astype(np.int64), 1e-9, []
    texts = [str(stamp).strip() for stamp in stamps]
    if (found := _LASTED.fullmatch(texts[0])) and spelled(found[2]) in TIME_UNITS:
        return np.array(list(_durations(texts, where))), 1.0, []
    if _OF_DAY.fullmatch(texts[0]):
        seconds = np.array(list(_of_day(texts, where)))
        unwrapped = np.unwrap(seconds, period=_DAY_S)
        after = np.flatnonzero(unwrapped - seconds > _DAY_S / 2)
        return unwrapped, 1.0, [f"the times of day pass midnight at row {after[0]}"] if after.size else []
    return np.array([_instant(text, row, where) for row, text in enumerate(texts)], np.int64), 1e-9, []


def _durations(texts: list[str], where: str) -> Iterator[float]:
    for row, text in enumerate(texts):
        found = _LASTED.fullmatch(text)
        if found is None or spelled(found[2]) not in TIME_UNITS:
            raise RunFileError(f"{where}: {text[:30]!r} in row {row} is no time with a unit, as 0.001 sec")
        yield float(found[1]) * TIME_UNITS[spelled(found[2])]


def _of_day(texts: list[str], where: str) -> Iterator[float]:
    for row, text in enumerate(texts):
        found = _OF_DAY.fullmatch(text)
        if found is None:
            raise RunFileError(f"{where}: {text[:30]!r} in row {row} is no time of day, as 01:59:58.001")
        yield 3600.0 * int(found[1]) + 60.0 * int(found[2]) + float(found[3].replace(",", "."))


def _instant(text: str, row: int, where: str) -> int:
    try:
        instant = datetime.fromisoformat(text)
    except ValueError:
        raise RunFileError(
            f"{where}: the column holds text ({text[:30]!r} in row {row}); stamps are numbers, instants of ISO 8601 "
            "(2026-03-29T01:59:58.001Z) or times of day (01:59:58.001)"
        ) from None
    instant = instant if instant.tzinfo else instant.replace(tzinfo=UTC)
    since = instant - datetime.fromtimestamp(0, UTC)
    return ((since.days * 86400 + since.seconds) * 1_000_000 + since.microseconds) * 1000


def _refuse_falls(values: FloatArray, time: Time, where: str) -> None:
    """A counter that starts again, and a clock that ends before it begins, are no time."""
    steps = np.diff(values)
    if not steps.size or steps.min() >= 0.0:
        return
    row = int(np.argmin(steps))
    period = float(np.median(steps))
    fall = period - float(steps[row])
    for bits, scale in _COUNTERS:
        size = scale * 2.0**bits
        if abs(fall - size) <= max(_NEAR * size, 2.0 * abs(period)):
            raise RunFileError(
                f"{where}: the time falls by {-steps[row]:.15g} {time.unit} at row {row + 1}: a counter of {bits} bits that "
                f"starts again; time.wrap: {size:.15g} carries it on"
            )
    if values[-1] <= values[0]:
        raise RunFileError(
            f"{where}: the time ends before it begins: it falls by {-steps[row]:.15g} {time.unit} at row {row + 1}; "
            "time.wrap carries a counter on that starts again"
        )
