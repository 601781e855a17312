"""A model as an FMI 2.0 co-simulation FMU, built by PythonFMU of the exported Python module."""

from __future__ import annotations

import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hapticd.export._python_module import module_text
from hapticd.export.errors import ExportError

if TYPE_CHECKING:
    from hapticd.config import Config

NEEDS = "The target needs Python 3.9 or later, and nothing besides: PythonFMU and the model are in the FMU."
_NAME = "hapticd_axis"


def write_fmu(config: Config, remarks: list[str], path: Path) -> None:
    """Write a config's axis as an FMU.

    Its input is ``command`` [A], taken over at every communication step; its outputs are ``position``, ``velocity``,
    ``current`` and ``measured``; its parameters ``initial_position`` and ``initial_velocity``.

    Args:
        config: the model. remarks: its description, a sentence each. path: the file to write.

    Raises:
        ExportError: PythonFMU is not installed, or fails.
    """
    try:
        builder: Any = import_module("pythonfmu").FmuBuilder
    except ImportError as error:
        raise ExportError(
            f"an FMU is built by PythonFMU, which is not installed: pip install 'hapticd[export]' ({error})"
        ) from error
    text = module_text(config, "\n".join([*remarks, NEEDS]), ("slave",))
    with tempfile.TemporaryDirectory() as folder:
        script = Path(folder) / f"{_NAME}.py"
        script.write_text(text)
        before = list(sys.path)
        try:
            builder.build_FMU(script, dest=Path(folder) / "axis.fmu")
        except (OSError, ValueError, TypeError) as error:
            raise ExportError(f"PythonFMU cannot build the FMU: {error}") from error
        finally:
            sys.path[:] = before
            sys.modules.pop(_NAME, None)
        path.write_bytes((Path(folder) / "axis.fmu").read_bytes())
