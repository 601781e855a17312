"""Where output goes: the answer to stdout, as text or as one JSON document; all else to stderr."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from contextvars import ContextVar
from typing import Any


def printable(text: str) -> str:
    """Text for a terminal: what would be obeyed there instead of shown is escaped."""
    if all(line.isprintable() for line in text.split("\n")):
        return text
    from hapticd.config.text import legible

    return legible(text, len(text))


def name(path: str | os.PathLike[str]) -> str:
    """A file's name or path in one line: whoever made it has chosen it."""
    return printable(os.fspath(path)).replace("\n", "\\n")


def to_json(document: Any) -> str:
    """JSON text; non-finite numbers become ``null``, numpy scalars numbers, paths text; a terminal obeys nothing in it."""
    text = json.dumps(_plain(document), indent=2, ensure_ascii=False, allow_nan=False)
    return _IN_JSON.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


_IN_JSON = re.compile("[\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""What JSON itself leaves as it is: control characters, what turns the direction of a line, bytes that are no UTF-8."""


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


quiet: ContextVar[bool] = ContextVar("quiet", default=False)
"""Whether the command was asked for its answer alone."""
as_json: ContextVar[bool] = ContextVar("as_json", default=False)
"""Whether the command was asked for its answer as data."""

last: ContextVar[Callable[[], object]] = ContextVar("last", default=lambda: None)
"""What is done after the command's last word: `hapticd run` gives a slow terminal a moment to take it."""


def emit(document: Mapping[str, Any], text: str) -> None:
    """Print the answer of a command: as data where that is wanted, else as text."""
    print(to_json(document) if as_json.get() else printable(text))


def warn(message: str) -> None:
    """Say what must not be missed: a warning, or why a command failed."""
    print(printable(f"hapticd: {message}"), file=sys.stderr)


def note(message: str) -> None:
    """Say something beside the answer, unless it is not wanted."""
    if not quiet.get():
        warn(message)


def number(value: Any, digits: int = 4) -> str:
    """A number to ``digits`` significant digits, without a fraction that says nothing; ``-`` for one not known."""
    if not isinstance(value, int | float) or not math.isfinite(value):
        return "-"
    return f"{value:.{digits}g}" if abs(value) < 10**digits else f"{value:.0f}"


@contextlib.contextmanager
def progress_bar(label: str) -> Iterator[Callable[[float], None]]:
    """A bar on a terminal (stderr), nothing in a pipe or where it is not wanted; yields what takes the fraction done."""
    if quiet.get() or not sys.stderr.isatty():
        yield lambda fraction: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(label, total=1.0)
        yield lambda fraction: progress.update(task, completed=fraction)
