"""What goes wrong with run files, in words for the person at the terminal."""

from __future__ import annotations


class RecordingError(Exception):
    """A recording could not be started, or ended early (disk full, directory not writable, file exists)."""


class RunExistsError(RecordingError):
    """The file of a new recording exists; nothing is ever overwritten."""


class RunFileError(Exception):
    """A run file cannot be read or exported."""
