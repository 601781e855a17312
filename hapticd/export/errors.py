"""What can go wrong in an export."""

from __future__ import annotations


class ExportError(Exception):
    """A model cannot be written; the text says why, and what would help."""
