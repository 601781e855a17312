"""An EDS file (CiA 306) as an object dictionary; file size and entry counts are checked before canopen reads it."""

from __future__ import annotations

import configparser
import io
from pathlib import Path
from typing import TYPE_CHECKING, Final

from drivers.interface import DriverConfigError
from hapticd.config.opening import open_regular
from hapticd.config.text import shown

if TYPE_CHECKING:
    from canopen import ObjectDictionary

_LARGEST_BYTES: Final = 4 << 20
_MOST_ENTRIES: Final = 254
"""Sub-indexes 1 to 254; canopen loops over ``NrOfEntries``."""


def load_eds(path: Path, node_id: int) -> ObjectDictionary:
    """Read an EDS or DCF file.

    Args:
        path: the file. node_id: for the COB-IDs that depend on it.

    Raises:
        DriverConfigError: it is not a regular file, is too large, or is not an EDS.
    """
    from canopen.objectdictionary import ObjectDictionaryError
    from canopen.objectdictionary.eds import import_eds

    text = _read(path)
    try:
        _check_counts(path, text)
        dictionary: ObjectDictionary = import_eds(io.StringIO(text), node_id)  # type: ignore[no-untyped-call]
    # Errors of canopen for a missing key, an invalid number, an entry outside an array.
    except (configparser.Error, ObjectDictionaryError, ValueError, LookupError, AttributeError, TypeError) as error:
        words = " ".join(str(error).split()) or type(error).__name__
        raise DriverConfigError(f"driver.eds = {path}: cannot be read as an EDS: {words}") from error
    return dictionary


def _read(path: Path) -> str:
    try:
        with open_regular(path) as file:
            data = file.read(_LARGEST_BYTES + 1)
    except OSError as error:
        raise DriverConfigError(f"driver.eds = {path}: {error.strerror}") from None
    if len(data) > _LARGEST_BYTES:
        raise DriverConfigError(f"driver.eds = {path}: is larger than {_LARGEST_BYTES >> 20} MiB; this is not an EDS")
    # Names may be in the maker's code page; everything used here is ASCII.
    return data.decode("utf-8-sig", errors="replace")


def _check_counts(path: Path, text: str) -> None:
    sections = configparser.RawConfigParser(inline_comment_prefixes=(";",))
    sections.read_string(text)
    if not sections.has_section("DeviceInfo"):
        raise DriverConfigError(f"driver.eds = {path}: has no section [DeviceInfo]; this is not an EDS")
    for section in sections.sections():
        entries = int(sections.get(section, "NrOfEntries", fallback="0"), 0)
        if entries > _MOST_ENTRIES:
            raise DriverConfigError(
                f"driver.eds = {path}: [{section}] NrOfEntries = {shown(entries)}: must be at most {_MOST_ENTRIES}"
            )
