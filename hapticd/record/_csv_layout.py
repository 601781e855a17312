"""How a text file of numbers is laid out: its delimiter, its names, a row of units. What the map says goes first."""

from __future__ import annotations

import csv
import functools
import io
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from hapticd.config.units import UNITS, spelled

DELIMITERS: Final = ("\t", ";", "|", ",", " ")
_LOOKED_AT: Final = 1000
"""Lines."""
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
        width: values of a row; 0 where no three rows are alike.
    """

    delimiter: str
    names: list[str] | None
    units: list[str]
    skip: int
    width: int


def look(path: Path, delimiter: str | None = None, header: bool | None = None, skip_lines: int = 0) -> Layout:
    """The layout of a file, from its first lines.

    The table is where three rows are alike. Names stand in the line above it, or above a row of units; or, as numpy writes
    them, behind ``#``.

    Args:
        path: the file. delimiter: as the map says; None: the one that splits the first lines alike.
        header: as the map says; None: there are names unless the first line is one of numbers.
        skip_lines: lines to pass over.
    """
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        lines = list(itertools.islice(file, skip_lines, skip_lines + _LOOKED_AT))
    at = [number for number, line in enumerate(lines) if line.strip() and not line.startswith("#")]
    text = [lines[number] for number in at]
    table = _table(text, [delimiter] if delimiter else DELIMITERS)
    sign, width, begin, column = table or (delimiter or _delimiter(text[:3][-2:]), 0, 0, 0)
    rows = [cells(line, sign) for line in text[: begin + 3]]
    if not rows:
        return Layout(sign, None, [], skip_lines + len(lines), 0)
    while begin and len(rows[begin - 1]) >= width and _is_number(rows[begin - 1][column]):
        begin -= 1  # with a word, or nothing, among its numbers
    named: int | None = 0
    if header is not None or table is None or _counted(rows[0]):
        if header is False or (header is None and _numeric(rows[0]) and not _counted(rows[0])):
            named, begin = None, 0
        else:
            begin = 1 + (len(rows) > 2 and not any(map(_is_number, rows[1])) and any(map(_is_number, rows[2])))
    else:
        named = begin - 1 - (begin > 1 and _are_units(*rows[begin - 2 : begin], first=begin == 2)) if begin else None
    names = rows[named] if named is not None else None
    if names is None and header is None and at[0] > 0:
        behind = cells(lines[at[0] - 1].lstrip("#"), sign)
        names = behind if len(behind) == len(rows[0]) > 1 else None
    elif names and header is None and table:
        names = _fitting(names, rows[begin] if begin < len(rows) else names, width, quoted='"' in text[named or 0])
    units = rows[begin - 1] if names and named is not None and begin - named == 2 else []
    return Layout(sign, names, units, skip_lines + ([*at, len(lines)][begin]), width)


def _table(lines: Sequence[str], signs: Sequence[str]) -> tuple[str, int, int, int] | None:
    """Where the first three rows are alike, with two numbers or more in each: delimiter, width, line, column of numbers."""

    @functools.cache
    def read(number: int, sign: str) -> tuple[list[bool], list[bool]]:
        row = cells(lines[number], sign)
        numbers = [_is_number(text) for text in row]
        return numbers, [is_number or not text for is_number, text in zip(numbers, row, strict=True)]

    for begin in range(len(lines) - 2):
        for sign in signs:
            (one, kinds), (two, kinds_2), (three, kinds_3) = (read(begin + after, sign) for after in range(3))
            if kinds == kinds_2 == kinds_3 and min(sum(one), sum(two), sum(three)) > 1:
                always = [all(each) for each in zip(one, two, three, strict=True)]
                return sign, len(one), begin, always.index(True) if any(always) else 0
    return None


def _fitting(names: list[str], row: Sequence[str], width: int, *, quoted: bool) -> list[str] | None:
    """Names of a table's columns; none where they are not as many."""
    if not any(name and name != "Comment" for name in names[width:]):  # of LabVIEW, which few rows have
        names = names[:width]
    if len(names) == width - 1 and not row[-1]:
        return [*names, ""]
    if len(names) == width - 1 and quoted:  # of R, whose numbers of rows have no name
        return ["", *names]
    return names if len(names) == width else None


def _are_units(above: Sequence[str], row: Sequence[str], *, first: bool) -> bool:
    """A row of units below names, which may be the ``first`` line, rather than names below a title."""
    if len(row) != len(above) or any(map(_is_number, row)):
        return False
    return any(spelled(text) in UNITS for text in row) or not any(row) or (first and len({*above} - {""}) == len(above))


def cells(line: str, delimiter: str) -> list[str]:
    """What stands in a line; a delimiter between quotes is none."""
    if delimiter == " ":
        line, delimiter = "\t".join(_WORD.findall(line)), "\t"
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]


def evened(path: Path, layout: Layout, width: int | None = None) -> io.BytesIO:
    """The rows with one tab between two values, and without what stands behind the ``width``-th."""
    out = io.StringIO()
    with path.open(encoding="utf-8", errors="surrogateescape") as file:
        rows = (cells(line, layout.delimiter)[:width] for line in itertools.islice(file, layout.skip, None))
        csv.writer(out, delimiter="\t", lineterminator="\n").writerows(rows)
    return io.BytesIO(out.getvalue().encode(errors="surrogateescape"))


def last_line(path: Path) -> str:
    """The last line that is not empty."""
    with path.open("rb") as file:
        file.seek(max(0, file.seek(0, io.SEEK_END) - _TAIL_BYTES))
        return (file.read().decode("utf-8", "replace").rstrip().splitlines() or [""])[-1]


def _delimiter(rows: Sequence[str]) -> str:
    for sign in DELIMITERS:
        parts = [cells(row, sign) for row in rows]
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


def is_comment(values: Sequence[str]) -> bool:
    """Whether words stand there, behind the last column, and no number that would belong to one."""
    return not any(map(_is_number, values))


def _numeric(fields: Sequence[str]) -> bool:
    return any(fields) and all(_is_number(text) for text in fields if text)


def _counted(fields: Sequence[str]) -> bool:
    """Columns that are named 0, 1, 2, as pandas does where they have no names."""
    fields = fields[1:] if fields and not fields[0] else fields  # above its index
    return len(fields) > 1 and list(fields) == [str(number) for number in range(len(fields))]
