"""Columns out of foreign files: text, .mat (structs, cells, matrices), .npy (either way round), .npz and .parquet."""

from __future__ import annotations

import re
import tokenize
import warnings
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapticd.config.nearest import nearest_name
from hapticd.config.opening import open_regular
from hapticd.config.text import decimal_comma
from hapticd.record._csv_layout import cells, evened, is_comment, last_line, look
from hapticd.record._reader import column_names, delimiter_hint, not_utf8, read_parquet, refuse_utf16
from hapticd.record.errors import RunFileError
from hapticd.record.importing_map import ImportMap, Reference
from hapticd.record.matfile import read_mat
from hapticd.record.sizes import check_unpacked, unpack_limit

_NAMES_SHOWN = 12
_DEEPEST = 8
_OF_MATRIX = re.compile(r"(.+?)(?:\(:,(\d+)\)|\((\d+),:\)|\[:,(\d+)\]|\[(\d+)(?:,:)?\])")
"""A column or row of a matrix: q(:,3) and q(3,:) as MATLAB counts, q[:,2] and q[2] as numpy does."""


def _some(names: Iterable[str]) -> str:
    """The first names, and how many more there are."""
    listed = list(names)
    more = len(listed) - _NAMES_SHOWN
    return ", ".join(listed[:_NAMES_SHOWN]) + (f" and {more} more" if more > 0 else "")


class Source:
    """The columns of a foreign file.

    Args:
        path: the file, for messages.
        names: of the columns, in the file's order; None: they have numbers only. A name may occur twice.
        arrays: the columns; one with two dimensions is a matrix of columns, which has no number.
        left_out: what no column can come from, with its shape.
        units: of each column, as far as the file says.
        notes: what a reader should know of the file.
    """

    def __init__(
        self,
        path: Path,
        names: Sequence[str] | None,
        arrays: Sequence[NDArray[Any]],
        left_out: Mapping[str, str] | None = None,
        units: Sequence[str] = (),
        notes: Sequence[str] = (),
    ) -> None:
        self.path = path
        self.names = list(names or ())
        self.arrays = list(arrays)
        self.numbered = [array for array in arrays if array.ndim <= 1]
        self._left_out = dict(left_out or {})
        self._units = list(units)
        self.notes = list(notes)

    def column(self, reference: Reference, key: str) -> NDArray[Any]:
        """Values of one column, (n,), of an integer or floating-point type, or of texts or instants.

        Args:
            reference: name or number. key: the map's key, for messages.

        Raises:
            RunFileError: there is no such column, or more than one.
        """
        values = np.atleast_1d(self._find(reference, f"{self.path}: {key} = {reference}"))
        if values.dtype.kind == "u":
            values = values.astype(np.int64 if values.size == 0 or int(values.max()) < 2**63 else np.float64)
        if not values.size:
            raise RunFileError(f"{self.path}: {key} = {reference}: the column is empty")
        return values

    def numbers(self, reference: Reference, key: str) -> NDArray[Any]:
        """Values of one column of numbers, (n,).

        Raises:
            RunFileError: there is no such column, or it holds no numbers.
        """
        values = self.column(reference, key)
        if values.dtype.kind not in "if":
            raise RunFileError(f"{self.path}: {key} = {reference}: the column holds {_other(values)}, not numbers")
        return values

    def unit(self, reference: Reference) -> str | None:
        """The unit that the file itself says of a column."""
        at = reference if isinstance(reference, int) else self.names.index(reference) if reference in self.names else -1
        return self._units[at] or None if 0 <= at < len(self._units) else None

    def _find(self, reference: Reference, where: str) -> NDArray[Any]:
        if isinstance(reference, int):
            if 0 <= reference < len(self.numbered):
                return self.numbered[reference]
            limit = f"the file has columns 0 to {len(self.numbered) - 1}" if self.numbered else "it has none"
            raise RunFileError(f"{where}: no such column; {limit}")
        found = [number for number, name in enumerate(self.names) if name == reference]
        if len(found) > 1:
            numbers = ", ".join(map(str, found))
            raise RunFileError(
                f"{where}: {len(found)} columns have that name; give the number of one: {numbers} (from 0)"
            )
        if found:
            if (array := self.arrays[found[0]]).ndim <= 1:
                return array
            raise RunFileError(f"{where}: a matrix of {_shape(array)}; one column of it is {_parts(reference, array)}")
        if (part := _OF_MATRIX.fullmatch(reference)) and self.names.count(part[1]) == 1:
            array = self.arrays[self.names.index(part[1])]
            column, row = (_index(part[2], part[4]), _index(part[3], part[5]))
            axis, at = (1, column) if column is not None else (0, row or 0)
            if array.ndim == 2 and 0 <= at < array.shape[axis]:
                return np.asarray(array.take(at, axis))
            raise RunFileError(f"{where}: {part[1]} has {_shape(array)}")
        raise RunFileError(f"{where}: no such column; {self._hint(reference)}")

    def _hint(self, reference: str) -> str:
        if any("\ufffd" in name for name in self.names):
            return not_utf8(self.path)
        if reference in self._left_out:
            return f"it is {self._left_out[reference]}, which no column can come from"
        shown = [
            name if array.ndim <= 1 else _parts(name, array)
            for name, array in zip(self.names, self.arrays, strict=False)
        ]
        close = nearest_name(reference, self.names)
        has = _some(shown) or "no named columns; use numbers from 0"
        if self._left_out:
            has += f"; left out: {_some(f'{name} ({what})' for name, what in self._left_out.items())}"
        hint = f"did you mean {close}? (it has: {has})" if close else f"the file has: {has}"
        return delimiter_hint(self.names) or hint


def refuse_missing(where: str, values: NDArray[Any]) -> None:
    """Refuse values of which some are none.

    Raises:
        RunFileError: with the row of the first.
    """
    missing = np.isnat(values) if values.dtype.kind in "mM" else ~np.isfinite(values)
    if (bad := np.flatnonzero(missing)).size:
        raise RunFileError(f"{where}: {bad.size} value(s) are missing or not finite, first in row {bad[0]}")


def _index(matlab: str | None, numpy: str | None) -> int | None:
    return int(matlab) - 1 if matlab is not None else int(numpy) if numpy is not None else None


def _shape(array: NDArray[Any]) -> str:
    return " x ".join(map(str, array.shape)) + (" values" if array.ndim == 1 else "")


def _parts(name: str, array: NDArray[Any]) -> str:
    """How the columns of a matrix are called, by its shorter axis."""
    rows = array.shape[0] < array.shape[1]
    first, last = (f"{name}({end},:)" if rows else f"{name}(:,{end})" for end in (1, min(array.shape)))
    return f"{first} to {last}"


def _other(values: NDArray[Any]) -> str:
    """What a column without numbers holds, with the first value that is none."""
    if values.dtype.kind not in "OUS":
        return str(values.dtype)
    for row, value in enumerate(values):
        if value is None:
            return f"nothing in row {row}"
        try:
            float(value)
        except (TypeError, ValueError):
            comma = "; csv.decimal: ',' in the map takes a comma as the decimal sign" if decimal_comma(value) else ""
            return f"text ({str(value)[:20]!r} in row {row}{comma})"
    return "text"


def read_source(path: Path, mapping: ImportMap) -> Source:
    """Open a foreign file.

    Raises:
        RunFileError: missing, unreadable, of another format, or without columns.
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise RunFileError(
            f"{path}: cannot import {path.suffix or 'a file without a suffix'}; {', '.join(_READERS)} can"
        )
    try:
        open_regular(path).close()
    except FileNotFoundError:
        raise RunFileError(f"cannot read {path}: no such file") from None
    except OSError as error:
        raise RunFileError(f"cannot read {path}: {error.strerror}") from error
    try:
        return reader(path, mapping)
    except OSError as error:
        raise RunFileError(f"cannot read {path}: {error.strerror or error}") from error


def _csv(path: Path, mapping: ImportMap) -> Source:
    import pyarrow as pa
    import pyarrow.csv as pacsv

    style = mapping.csv
    asked = "\t" if style.delimiter == "\\t" else style.delimiter
    if asked is not None and len(asked) != 1:
        raise RunFileError(f"{path}: csv.delimiter = {asked!r}: must be one character, or \\t for a tab")
    refuse_utf16(path)
    layout = look(path, asked, style.header, style.skip_lines)
    odd: list[list[str]] = []

    def read(source: Any, delimiter: str, skip: int = 0) -> Any:
        odd.clear()

        def set_aside(row: Any) -> str:
            odd.append(cells(row.text, delimiter))
            return "skip"

        return pacsv.read_csv(
            source,
            read_options=pacsv.ReadOptions(
                skip_rows=skip,
                column_names=[str(number) for number in range(layout.width)] or None,
                autogenerate_column_names=not layout.width,
            ),
            parse_options=pacsv.ParseOptions(delimiter=delimiter, invalid_row_handler=set_aside),
            convert_options=pacsv.ConvertOptions(decimal_point=style.decimal),
        )

    try:
        if layout.delimiter == " ":
            table = read(evened(path, layout), "\t")
        else:
            table = read(path, layout.delimiter, layout.skip)
        if odd and layout.width and all(is_comment(values[layout.width :]) for values in odd):
            table = read(evened(path, layout, layout.width), "\t")
    except pa.ArrowException as error:
        why = str(error).splitlines()[0]
        if layout.names and "Empty CSV" in why:
            return Source(path, layout.names, [np.empty(0)] * len(layout.names))
        raise RunFileError(f"{path} is not a readable CSV file: {why}") from None
    if odd and not (len(odd[0]) < table.num_columns and odd == [cells(last_line(path), layout.delimiter)]):
        raise RunFileError(
            f"{path} is not a readable CSV file: CSV parse error: Expected {table.num_columns} columns, got "
            f"{len(odd[0])}: {layout.delimiter.join(odd[0])} (csv.delimiter is {layout.delimiter!r}, csv.skip_lines "
            f"{style.skip_lines})"
        )
    if layout.names and len(layout.names) != table.num_columns:
        raise RunFileError(
            f"{path}: {len(layout.names)} names, but {table.num_columns} columns of values (csv.delimiter is "
            f"{layout.delimiter!r}, csv.skip_lines {style.skip_lines})"
        )
    notes = ["the last line is cut off, and left out"] if odd else []
    arrays = [column.to_numpy() for column in table.columns]
    return Source(path, layout.names, arrays, units=layout.units, notes=notes)


def _parquet(path: Path, mapping: ImportMap) -> Source:
    import pyarrow as pa

    table = read_parquet(path)
    for _ in range(_DEEPEST):
        table = table.flatten()  # structs: a.b
    names = [name.strip() for name in column_names(path, table)]
    return Source(path, names, [_of_arrow(column, pa) for column in table.columns])


def _of_arrow(column: Any, pa: Any) -> NDArray[Any]:
    """Values of a column; lists of one length are a matrix."""
    kind = column.type
    if pa.types.is_decimal(kind):
        column = column.cast(pa.float64())
    elif pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind):
        lists = column.combine_chunks()
        sizes = np.unique(pa.compute.list_value_length(lists).to_numpy(zero_copy_only=False))
        if sizes.size == 1 and sizes[0] > 0:  # NaN, of one that is missing, is not
            return np.asarray(pa.compute.list_flatten(lists).to_numpy(zero_copy_only=False).reshape(len(lists), -1))
    return np.asarray(column.to_numpy())


def _npy(path: Path, mapping: ImportMap) -> Source:
    try:
        # Mapped, not read: a header that claims more than the file holds is an error here, and no memory.
        with np.errstate(over="raise"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that it was written by Python 2
            data = np.load(path, allow_pickle=False, mmap_mode="r")
    except EOFError:
        raise RunFileError(f"{path} is empty") from None
    except (ValueError, TypeError, ArithmeticError, SyntaxError, tokenize.TokenError) as error:
        why = "it holds no plain array of numbers" if "pickle" in str(error) else str(error)
        raise RunFileError(f"{path} is not a readable .npy file: {why}") from None
    if not isinstance(data, np.ndarray):
        raise RunFileError(f"{path} holds several arrays: it is an .npz; rename it")
    if data.dtype.names:
        found = _fields("", data)
        return Source(path, list(found), list(found.values()))
    return Source(path, None, _channels(path, data, mapping))


def _npz(path: Path, mapping: ImportMap) -> Source:
    limit = unpack_limit(path.stat().st_size)
    found: dict[str, NDArray[Any]] = {}
    left_out: dict[str, str] = {}
    try:
        with zipfile.ZipFile(path) as members:
            check_unpacked(path, sum(member.file_size for member in members.infolist()), limit)
        with np.load(path, allow_pickle=False) as archive:
            for name in archive.files:
                try:
                    array = archive[name]
                    found |= _fields(f"{name}.", array) if array.dtype.names else {name: np.squeeze(array)}
                except ValueError:
                    left_out[name] = "an array of Python objects"
    except (
        ValueError,
        TypeError,
        ArithmeticError,
        SyntaxError,
        EOFError,
        NotImplementedError,
        zipfile.BadZipFile,
    ) as error:
        raise RunFileError(f"{path} is not a readable .npz file: {error}") from None
    return _named(path, found, left_out, mapping)


def _fields(lead: str, data: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Fields of an array of structs, (n,) or (n, k)."""
    rows = data.ravel()
    return {f"{lead}{name}": rows[name] for name in data.dtype.names or () if rows[name].ndim <= 2}


def _channels(path: Path, data: NDArray[Any], mapping: ImportMap) -> list[NDArray[Any]]:
    if data.ndim == 1:
        return [data]
    if data.ndim != 2:
        raise RunFileError(f"{path}: an array of shape {data.shape}; the columns need one or two dimensions")
    rows = mapping.channels == "rows" or (mapping.channels == "auto" and data.shape[0] < data.shape[1])
    return list(np.ascontiguousarray(data if rows else data.T))


def _mat(path: Path, mapping: ImportMap) -> Source:
    return _named(path, *read_mat(path), mapping)


def _named(path: Path, found: dict[str, NDArray[Any]], left_out: dict[str, str], mapping: ImportMap) -> Source:
    """Arrays with names; of ``variable``, what is inside it, or the channels of the matrix that it is."""
    wanted = mapping.variable
    if wanted is not None:
        if wanted in found:
            return Source(path, None, _channels(path, found[wanted], mapping))
        inside = re.compile(re.escape(wanted) + r"(\.|(?=[({]))")
        every = list(found)
        found = {inside.sub("", name, count=1): value for name, value in found.items() if inside.match(name)}
        left_out = {inside.sub("", name, count=1): what for name, what in left_out.items() if inside.match(name)}
        if not found:
            close = nearest_name(wanted, {*every, *(name.rpartition(".")[0] for name in every)} - {""})
            hint = f"did you mean {close}?" if close else f"it has: {_some(every)}"
            raise RunFileError(f"{path}: variable = {wanted}: no such variable; {hint}")
    left_out |= {name: f"an array of {_shape(value)}" for name, value in found.items() if value.ndim > 2}
    columns = {name: value for name, value in found.items() if value.ndim <= 2}
    return Source(path, list(columns), list(columns.values()), left_out)


_READERS: dict[str, Callable[[Path, ImportMap], Source]] = {
    ".csv": _csv,
    ".txt": _csv,
    ".tsv": _csv,
    ".dat": _csv,
    ".asc": _csv,
    ".log": _csv,
    ".lvm": _csv,
    ".mat": _mat,
    ".npy": _npy,
    ".npz": _npz,
    ".parquet": _parquet,
}
