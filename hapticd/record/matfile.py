"""Numbers and texts out of MATLAB files of level 5 (``save -v6`` and ``-v7``).

scipy's reader trusts the file's own type codes and sizes: one wrong byte can end the process, and a few compressed ones can
claim any memory. Here each size is held against the bytes that are there before anything is made of it. What no column can
come from (cells, objects, sparse arrays, functions) is named and left out.

Format: MathWorks, "MAT-File Format", level 5.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapticd.record.errors import RunFileError
from hapticd.record.sizes import check_unpacked, unpack_limit

_HEADER_BYTES: Final = 128
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Type of stored values to numpy's."""
_TEXTS: Final = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE = 1, 2, 3, 4, 5
_CLASSES: Final = dict(zip(range(6, 16), ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"), strict=True))
_NAMES: Final = {
    _CELL: "a cell array",
    _OBJECT: "an object",
    _SPARSE: "a sparse array",
    16: "a function",
    17: "an object",
}
_COMPLEX: Final = 0x800
_DEEPEST: Final = 32
_MOST_DIMENSIONS: Final = 32


def is_level_5(data: bytes) -> bool:
    """Whether the file says that it is one; the header of level 4 begins with a number below 5000."""
    return len(data) >= _HEADER_BYTES and data[126:128] in (b"IM", b"MI") and 0 not in data[:4]


def read_level_5(path: Path, data: bytes) -> dict[str, NDArray[Any]]:
    """Every variable, those of structs as ``struct.field``; dimensions of one element are dropped.

    Args:
        path: for messages. data: the file.

    Raises:
        RunFileError: it is damaged, of HDF5 (``save -v7.3``), or unpacks to too much.
    """
    order = "<" if data[126:128] == b"IM" else ">"
    version = struct.unpack_from(f"{order}H", data, 124)[0]
    if version == 0x0200:
        raise RunFileError(f"{path} is a MATLAB 7.3 (HDF5) file; save it with -v7 in MATLAB")
    reader = _Reader(path, order, unpack_limit(len(data)))
    found: dict[str, NDArray[Any]] = {}
    try:
        for kind, content in reader.elements(memoryview(data)[_HEADER_BYTES:]):
            for inner, matrix in (
                reader.elements(reader.inflated(content)) if kind == _COMPRESSED else [(kind, content)]
            ):
                if inner == _MATRIX:
                    name, value = reader.matrix(matrix, 0)
                    _flatten(name, value, found)
    except _DamagedError as error:
        raise RunFileError(f"{path} is not a readable .mat file: {error}") from None
    return found


class _DamagedError(Exception):
    """What does not fit, in words."""


@dataclass(frozen=True)
class _Struct:
    fields: dict[str, Any]


def _flatten(name: str, value: Any, into: dict[str, NDArray[Any]]) -> None:
    if isinstance(value, _Struct):
        for field, item in value.fields.items():
            _flatten(f"{name}.{field}", item, into)
    else:
        into[name] = np.asarray(value)


class _Reader:
    """The elements of one file; ``order`` is ``<`` or ``>``."""

    def __init__(self, path: Path, order: str, limit: int) -> None:
        self._path, self._order, self._limit = path, order, limit
        self._unpacked = 0

    def _count(self, size: int) -> None:
        self._unpacked += size
        check_unpacked(self._path, self._unpacked, self._limit)

    def inflated(self, content: memoryview) -> memoryview:
        """A compressed element, up to the limit."""
        room = self._limit - self._unpacked + 1
        try:
            data = zlib.decompressobj().decompress(content, room)
        except zlib.error as error:
            raise _DamagedError(f"a variable cannot be unpacked ({error})") from None
        self._count(len(data))
        return memoryview(data)

    def elements(self, data: memoryview) -> Iterator[tuple[int, memoryview]]:
        """Type and content of each element, one after the other."""
        at = 0
        while at + 8 <= len(data):
            kind, size = struct.unpack_from(f"{self._order}II", data, at)
            if kind >> 16:  # up to four bytes, in the tag itself
                kind, size, begin, after = kind & 0xFFFF, kind >> 16, at + 4, at + 8
                if size > 4:
                    raise _DamagedError(f"a short element claims {size} bytes")
            else:
                begin = at + 8
                # Compressed elements are not filled up to eight bytes.
                after = begin + size + (0 if kind == _COMPRESSED else -size % 8)
            if begin + size > len(data):
                raise _DamagedError(f"an element claims {size} bytes where {len(data) - begin} are left")
            yield kind, data[begin : begin + size]
            at = after

    def matrix(self, data: memoryview, depth: int) -> tuple[str, Any]:
        """Name and value of an array: numbers, a text, a `_Struct`, or the words for what else it is."""
        if depth > _DEEPEST:
            raise _DamagedError("its structs are nested too deeply")
        if not data:
            return "", np.empty(0)
        parts = self.elements(data)
        flags = self._integers(_next(parts), "u4", "flags")
        kind, flags_word = int(flags[0]) & 0xFF, int(flags[0])
        if kind == 17:
            return bytes(_next(parts)[1]).decode(errors="replace"), _NAMES[kind]
        shape = tuple(self._integers(_next(parts), "i4", "dimensions").tolist())
        name = bytes(_next(parts)[1]).decode(errors="replace")
        if not 1 <= len(shape) <= _MOST_DIMENSIONS or min(shape) < 0:
            raise _DamagedError(f"{_quoted(name)} has the dimensions {shape[:4]}")
        if kind in _NAMES:
            return name, _NAMES[kind]
        if kind == _STRUCT:
            return name, self._struct(name, shape, parts, depth)
        if kind == _CHAR:
            return name, self._text(_next(parts))
        if kind not in _CLASSES:
            raise _DamagedError(f"{_quoted(name)} is of the unknown class {kind}")
        return name, self._numbers(name, shape, kind, flags_word, parts)

    def _numbers(
        self, name: str, shape: tuple[int, ...], kind: int, flags: int, parts: Iterator[tuple[int, memoryview]]
    ) -> NDArray[Any]:
        wanted = np.dtype(_CLASSES[kind])
        values = []
        for _ in range(2 if flags & _COMPLEX else 1):
            stored, content = _next(parts)
            if stored not in _NUMBERS:
                raise _DamagedError(f"{_quoted(name)} holds values of the unknown type {stored}")
            raw = self._values(content, _NUMBERS[stored])
            if raw.size != math.prod(shape):
                raise _DamagedError(f"{_quoted(name)} has {raw.size} values for the dimensions {shape[:4]}")
            self._count(raw.size * wanted.itemsize)
            with np.errstate(all="ignore"):  # a class that is too narrow for its own values is the file's fault
                values.append(raw.astype(wanted))
        with np.errstate(all="ignore"):  # infinite times i
            found = values[0] if len(values) == 1 else values[0] + 1j * values[1]
        return np.squeeze(found.reshape(shape, order="F")) if found.size else found

    def _struct(self, name: str, shape: tuple[int, ...], parts: Iterator[tuple[int, memoryview]], depth: int) -> Any:
        length = int(self._integers(_next(parts), "i4", "length of the fields' names")[0])
        names = bytes(_next(parts)[1])
        if math.prod(shape) != 1:
            return "an array of structs"
        if length < 1 or len(names) % length:
            raise _DamagedError(f"the fields of {_quoted(name)} have no legible names")
        fields = {}
        for at in range(0, len(names), length):
            field = names[at : at + length].partition(b"\0")[0].decode(errors="replace")
            kind, content = _next(parts)
            if kind != _MATRIX:
                raise _DamagedError(f"{_quoted(f'{name}.{field}')} is no array")
            fields[field] = self.matrix(content, depth + 1)[1]
        return _Struct(fields)

    def _text(self, part: tuple[int, memoryview]) -> str:
        kind, content = part
        coding = _TEXTS.get(kind, "latin-1")
        if coding in ("utf-16", "utf-32"):
            coding += "-le" if self._order == "<" else "-be"
        return bytes(content).decode(coding, errors="replace").rstrip("\0")

    def _integers(self, part: tuple[int, memoryview], kind: str, what: str) -> NDArray[Any]:
        values = self._values(part[1], kind)
        if not values.size:
            raise _DamagedError(f"a variable has no {what}")
        return values

    def _values(self, content: memoryview, kind: str) -> NDArray[Any]:
        dtype = np.dtype(kind).newbyteorder(self._order)  # type: ignore[arg-type]
        if len(content) % dtype.itemsize:
            raise _DamagedError(f"{len(content)} bytes are no whole number of values of {dtype.itemsize}")
        return np.frombuffer(content, dtype)


def _next(parts: Iterator[tuple[int, memoryview]]) -> tuple[int, memoryview]:
    part = next(parts, None)
    if part is None:
        raise _DamagedError("a variable ends too early")
    return part


def _quoted(name: str) -> str:
    return repr(name[:64])
