"""Columns out of foreign files: .csv, .mat (structs within structs), .npy (either way round) and .parquet."""

from __future__ import annotations

import io
import tokenize
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapticd.config.nearest import nearest_name
from hapticd.config.opening import open_regular
from hapticd.config.text import decimal_comma
from hapticd.record.errors import RunFileError
from hapticd.record.importing_map import ImportMap, Reference
from hapticd.record.matfile import is_level_5, read_level_5
from hapticd.record.reader import column_names, delimiter_hint, read_parquet, refuse_utf16

_NAMES_SHOWN = 12


def _some(names: Mapping[str, Any]) -> str:
    """The first names, and how many more there are."""
    shown = list(names)[:_NAMES_SHOWN]
    more = len(names) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")


class Source:
    """The columns of a foreign file.

    Args:
        path: the file, for messages.
        named: name → values, 1-D.
        numbered: columns in the file's order.
    """

    def __init__(self, path: Path, named: Mapping[str, NDArray[Any]], numbered: list[NDArray[Any]]) -> None:
        self.path = path
        self.named = dict(named)
        self.numbered = numbered

    def column(self, reference: Reference, key: str) -> NDArray[Any]:
        """Values of one column, (n,), of an integer or floating-point type.

        Args:
            reference: name or number. key: the map's key, for messages.

        Raises:
            RunFileError: there is no such column, or it holds no numbers.
        """
        if isinstance(reference, int):
            if not 0 <= reference < len(self.numbered):
                limit = f"the file has columns 0 to {len(self.numbered) - 1}" if self.numbered else "it has none"
                raise RunFileError(f"{self.path}: {key} = {reference}: no such column; {limit}")
            values = self.numbered[reference]
        elif reference in self.named:
            values = self.named[reference]
        else:
            close = nearest_name(reference, self.named)
            has = _some(self.named) or "no named columns; use numbers from 0"
            hint = f"did you mean {close}? (it has: {has})" if close else f"the file has: {has}"
            hint = delimiter_hint(self.named) or hint
            raise RunFileError(f"{self.path}: {key} = {reference}: no such column; {hint}")
        if values.dtype.kind == "u":
            values = values.astype(np.int64 if values.size == 0 or int(values.max()) < 2**63 else np.float64)
        if not values.size:
            raise RunFileError(f"{self.path}: {key} = {reference}: the column is empty")
        if values.dtype.kind not in "if":
            raise RunFileError(f"{self.path}: {key} = {reference}: the column holds {_other(values)}, not numbers")
        return values


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
    delimiter = "\t" if style.delimiter == "\\t" else style.delimiter
    if len(delimiter) != 1:
        raise RunFileError(f"{path}: csv.delimiter = {delimiter!r}: must be one character, or \\t for a tab")
    refuse_utf16(path)
    skip = style.skip_lines
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        lines = (line for number, line in enumerate(file) if number >= style.skip_lines)
        for line in lines:
            if not line.startswith("#"):
                break
            skip += 1
    try:
        table = pacsv.read_csv(
            path,
            read_options=pacsv.ReadOptions(skip_rows=skip, autogenerate_column_names=not style.header),
            parse_options=pacsv.ParseOptions(delimiter=delimiter),
            convert_options=pacsv.ConvertOptions(decimal_point=style.decimal),
        )
    except pa.ArrowException as error:
        why = str(error).splitlines()[0]
        if "columns, got" in why:
            why += f" (csv.delimiter is {style.delimiter!r}, csv.skip_lines {style.skip_lines})"
        raise RunFileError(f"{path} is not a readable CSV file: {why}") from None
    return _from_table(path, table, named=style.header)


def _parquet(path: Path, mapping: ImportMap) -> Source:
    return _from_table(path, read_parquet(path), named=True)


def _from_table(path: Path, table: Any, *, named: bool) -> Source:
    names = [name.strip() for name in column_names(path, table)]
    numbered = [column.to_numpy() for column in table.columns]
    return Source(path, dict(zip(names, numbered, strict=True)) if named else {}, numbered)


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
        raise RunFileError(f"{path} holds several arrays (.npz); save the one that is meant as .npy")
    if data.dtype.names:
        numbered = [data[name].ravel() for name in data.dtype.names]
        return Source(path, dict(zip(data.dtype.names, numbered, strict=True)), numbered)
    return Source(path, {}, _channels(path, data, mapping))


def _channels(path: Path, data: NDArray[Any], mapping: ImportMap) -> list[NDArray[Any]]:
    if data.ndim == 1:
        return [data]
    if data.ndim != 2:
        raise RunFileError(f"{path}: an array of shape {data.shape}; the columns need one or two dimensions")
    rows = mapping.channels == "rows" or (mapping.channels == "auto" and data.shape[0] < data.shape[1])
    return list(np.ascontiguousarray(data if rows else data.T))


def _mat(path: Path, mapping: ImportMap) -> Source:
    with open_regular(path) as file:
        data = file.read()
    named: dict[str, Any] = read_level_5(path, data) if is_level_5(data) else _mat_level_4(path, data)
    wanted = mapping.variable
    if wanted is not None:
        inside = {
            name.removeprefix(f"{wanted}."): value for name, value in named.items() if name.startswith(f"{wanted}.")
        }
        if not inside and wanted not in named:
            close = nearest_name(wanted, {*named, *(name.rpartition(".")[0] for name in named)} - {""})
            hint = f"did you mean {close}?" if close else f"it has: {_some(named)}"
            raise RunFileError(f"{path}: variable = {wanted}: no such variable; {hint}")
        if not inside:
            return Source(path, {}, _channels(path, np.asarray(named[wanted]), mapping))
        named = inside
    columns = {name: np.atleast_1d(value) for name, value in named.items() if np.ndim(value) <= 1}
    return Source(path, columns, list(columns.values()))


def _mat_level_4(path: Path, data: bytes) -> dict[str, Any]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError, matfile_version

    memory: Any = io.BytesIO(data)  # a read of more than there is gives what there is, and takes no more
    try:
        if matfile_version(memory)[0] != 0:
            raise RunFileError(f"{path} is not a readable .mat file: its header is damaged")
        with warnings.catch_warnings(), np.errstate(all="ignore"):  # infinite times i, text beyond its type
            warnings.simplefilter("error")
            contents = loadmat(memory, squeeze_me=True)
    except (MatReadError, ValueError, TypeError, OSError, LookupError, ArithmeticError, UserWarning) as error:
        raise RunFileError(f"{path} is not a readable .mat file: {error}") from None
    return {name: np.asarray(value) for name, value in contents.items() if not name.startswith("__")}


_READERS: dict[str, Callable[[Path, ImportMap], Source]] = {
    ".csv": _csv,
    ".mat": _mat,
    ".npy": _npy,
    ".parquet": _parquet,
}
