"""The model for other simulators: MuJoCo, URDF, FMI and plain Python; ``table`` has what each can say of each effect."""

from __future__ import annotations

from hapticd.export._write import SUFFIXES, module_beside, write_model
from hapticd.export.errors import ExportError
from hapticd.export.table import FORMATS, TABLE, Format, Saying, sayings

__all__ = ["FORMATS", "SUFFIXES", "TABLE", "ExportError", "Format", "Saying", "module_beside", "sayings", "write_model"]
