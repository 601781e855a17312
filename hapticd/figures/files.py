"""Files that are there whole or not at all, that replace no other unasked, and errors that name them."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def refuse_existing(target: Path, *, force: bool, source: Path | None = None) -> None:
    """Refuse to replace a file: the one rule of all that is written where a user says.

    Raises:
        FileExistsError: it exists, and ``force`` is not given; or it is ``source``, which is read.
    """
    if source is not None and _is_same(source, target):
        raise FileExistsError(f"{target} is the file that is read; give another name")
    if os.path.lexists(target) and not force:
        raise FileExistsError(f"{target} exists; give another name, or --force to replace it")


def _is_same(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except OSError:  # one of them is not there
        return False


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Have an error of the file system name this path: a full disk's names none, a scratch file's one that is gone.

    Raises:
        OSError: as within, with the path's name.
    """
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


@contextlib.contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """A file to be written beside a path: it takes the path's name where all goes well, and is gone otherwise."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Put a text that everybody may read in a path's place: who reads it finds the old text or the new one.

    Raises:
        OSError: the folder is not there or not writable.
    """
    with atomic_write(path) as part:
        part.write_text(text)
        part.chmod(0o644)


def save_figure(figure: Figure, path: Path, dpi: int = 130) -> None:
    """Write a figure in the format that the path's suffix names (png, svg, pdf); png without one.

    Raises:
        OSError: it cannot be written; what was there before still is.
        ValueError: matplotlib knows no such format.
    """
    kind = path.suffix.lstrip(".") or "png"
    with naming(path), atomic_write(path) as part:
        figure.savefig(part, format=kind, dpi=dpi)
