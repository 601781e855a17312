"""Errors of the gap workflow."""

from __future__ import annotations


class RecordingError(Exception):
    """A recording is unusable or contradicts itself; the text says why."""
