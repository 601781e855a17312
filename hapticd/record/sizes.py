"""How much a file may unpack to: a few compressed bytes can stand for gigabytes."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from hapticd.record.errors import RunFileError

LEAST: Final = 1 << 28
_GROWTH: Final = 200


def unpack_limit(stored: int) -> int:
    """Bytes that a file of ``stored`` bytes may unpack to: 200 times its own, and 256 MiB for a small one."""
    return max(LEAST, _GROWTH * stored)


def check_unpacked(path: Path, size: int, limit: int) -> None:
    """Refuse what is no recording any more.

    Args:
        path: the file. size: bytes that it unpacks to, as far as is known. limit: of `unpack_limit`.

    Raises:
        RunFileError: it is more.
    """
    if size > limit:
        raise RunFileError(f"{path} unpacks to more than {limit >> 20} MiB; this is not a recording")
