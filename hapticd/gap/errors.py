"""What goes wrong in the gap workflow, in words for the person at the terminal."""

from __future__ import annotations


class RecordingError(Exception):
    """A recording from which nothing can be concluded, or that cannot mean what it says; the text says why."""
