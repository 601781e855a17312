"""What goes wrong with run files, in words for the person at the terminal."""

from __future__ import annotations

from typing import Final

from hapticd.config.text import legible

_LONGEST: Final = 4000


class RecordingError(Exception):
    """A recording could not be started, or ended early (disk full, directory not writable, file exists)."""


class RunExistsError(RecordingError):
    """The file of a new recording exists; nothing is ever overwritten."""


class RunFileError(Exception):
    """A run file cannot be read or exported. What is quoted from the file is made legible."""

    def __init__(self, text: str) -> None:
        super().__init__(legible(text, _LONGEST))
