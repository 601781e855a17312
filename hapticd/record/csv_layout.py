"""How a text file of numbers is laid out: its delimiter, its names, a row of units. What the map says goes first."""

from __future__ import annotations

import csv
import io
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from hapticd.config.units import UNITS, spelled

DELIMITERS: Final = ("\t", ";", "|", ",")
_LOOKED_AT: Final = 1000
"""Lines before the data."""
_TAIL_BYTES: Final = 1 << 16
_WORD: Final = re.compile(r'"(?:[^"]|"")*"|\S+')
csv.field_size_limit(1 << 30)  # an exported run has its metadata in one cell


@dataclass(frozen=True)
class Layout:
    """How a file is read.

    Attributes:
        delimiter: one character; a space stands for any number of spaces and tabs.
        names: of the columns; none where the file has none.
        units: what a row below the names says of each column.
        skip: lines before the first row of numbers.
    """

    delimiter: str
    names: list[str] | None
    units: list[str]
    skip: int


def look(path: Path, delimiter: str | None = None, header: bool | None = None, skip_lines: int = 0) -> Layout:
    """The layout of a file, from its first lines.

    Names stand in the first line; or, as numpy writes them, behind ``#`` in the line before the first row; or in the line
    before the first three rows of numbers that are alike, where something else than a table comes first.

    Args:
        path: the file. delimiter: as the map says; None: the one that splits the first lines alike.
        header: as the map says; None: the first line holds names unless all of it are numbers.
        skip_lines: lines to pass over.
    """
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        lines = list(itertools.islice(file, skip_lines, skip_lines + _LOOKED_AT))
    at = next((number for number, line in enumerate(lines) if line.strip() and not line.startswith("#")), len(lines))
    rows = [line for line in lines[at : at + 3] if line.strip()]
    sign, width, begin = _table(lines, [delimiter] if delimiter else [*DELIMITERS, " "]) or (None, 0, -1)
    if sign and header is None and not skip_lines and len(cells(lines[at], sign)) != width:
        return _below_a_preamble(lines, sign, width, begin)
    sign = sign or delimiter or _delimiter(rows)
    fields = [cells(row, sign) for row in rows]
    skip = skip_lines + at
    if not fields:
        return Layout(sign, None, [], skip)
    if header if header is not None else _counted(fields[0]) or not (begin == at or _numeric(fields[0])):
        units = fields[1] if len(fields) > 2 and _is_units(fields[1], fields[2]) else []
        return Layout(sign, fields[0], units, skip + 1 + bool(units))
    comment = cells(lines[at - 1].lstrip("#"), sign) if header is None and at > 0 else []
    return Layout(sign, comment if len(comment) == len(fields[0]) > 1 else None, [], skip)


def _table(lines: Sequence[str], signs: Sequence[str]) -> tuple[str, int, int] | None:
    """Delimiter, width and first line of the first three rows that are alike, with two numbers or more in each."""
    for begin in range(len(lines) - 2):
        for sign in signs:
            rows = [cells(line, sign) for line in lines[begin : begin + 3]]
            kinds = [[_is_number(text) or not text for text in row] for row in rows]
            if kinds[0] == kinds[1] == kinds[2] and all(sum(map(_is_number, row)) > 1 for row in rows):
                return sign, len(rows[0]), begin
    return None


def _below_a_preamble(lines: Sequence[str], sign: str, width: int, begin: int) -> Layout:
    """The layout where lines of another kind come before the table; names that fit its rows stand right above them."""
    at = next((number for number in range(begin - 1, -1, -1) if lines[number].strip()), 0)
    names, above, units = cells(lines[at].lstrip("#"), sign), cells(lines[at - 1], sign), []
    if len(above) == len(names) and any(spelled(text) in UNITS for text in names):
        names, units = above, names
    if len(names) == width + 1 and names[-1] == "Comment":  # of LabVIEW, which few rows have
        names = names[:-1]
    elif len(names) == width - 1 and not cells(lines[begin], sign)[-1]:
        names = [*names, ""]
    elif len(names) == width - 1 and '"' in lines[at]:  # of R, whose numbers of rows have no name
        names = ["", *names]
    fits = len(names) == width and not any(map(_is_number, names))
    return Layout(sign, names if fits else None, units if fits else [], begin)


def cells(line: str, delimiter: str) -> list[str]:
    """What stands in a line; a delimiter between quotes is none."""
    if delimiter == " ":
        line, delimiter = _tabbed(line), "\t"
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]


def squeezed(path: Path) -> io.BytesIO:
    """The file with one tab for every run of spaces and tabs."""
    with path.open(encoding="utf-8", errors="surrogateescape") as file:
        return io.BytesIO("\n".join(map(_tabbed, file)).encode(errors="surrogateescape"))


def last_line(path: Path, spaced: bool) -> str:
    """The last line that is not empty, as `squeezed` gives it where ``spaced``."""
    with path.open("rb") as file:
        file.seek(max(0, file.seek(0, io.SEEK_END) - _TAIL_BYTES))
        line = (file.read().decode("utf-8", "replace").splitlines() or [""])[-1]
    return _tabbed(line) if spaced else line


def _tabbed(line: str) -> str:
    return "\t".join(_WORD.findall(line))


def _delimiter(rows: Sequence[str]) -> str:
    for sign in (*DELIMITERS, " "):
        parts = [cells(row, sign) for row in rows[-2:]]
        widths = {len(part) for part in parts}
        if len(widths) == 1 and widths.isdisjoint({0, 1}) and (sign != " " or _numeric(parts[-1])):
            return sign
    return ","


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", ".", 1))
    except ValueError:
        return False
    return True


def _numeric(fields: Sequence[str]) -> bool:
    return any(fields) and all(_is_number(text) for text in fields if text)


def _counted(fields: Sequence[str]) -> bool:
    """Columns that are named 0, 1, 2, as pandas does where they have no names."""
    fields = fields[1:] if fields and not fields[0] else fields  # above its index
    return len(fields) > 1 and list(fields) == [str(number) for number in range(len(fields))]


def _is_units(row: Sequence[str], after: Sequence[str]) -> bool:
    """A row below the names without a number in it, before one that has some."""
    return not any(_is_number(text) for text in row) and any(_is_number(text) for text in after)
