"""A config's axis as files of another simulator."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

from hapticd.export._fmu import write_fmu
from hapticd.export._mjcf import mjcf
from hapticd.export._python_module import module_text
from hapticd.export._urdf import urdf
from hapticd.export.head import remarks
from hapticd.figures.files import atomic_write, naming, write_text

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hapticd.config import Config
    from hapticd.export.table import Format

SUFFIXES: Final[Mapping[Format, str]] = {"mjcf": ".xml", "urdf": ".urdf", "fmu": ".fmu", "python": ".py"}
"""Of the file that each format is written to."""


def module_beside(target: Path) -> Path:
    """Where the Python module is for what an MJCF file cannot say: its name can be imported."""
    return target.with_name(f"{re.sub(r'[^A-Za-z0-9_]', '_', target.stem)}_mujoco.py")


def write_model(config: Config, to: Format, target: Path) -> list[Path]:
    """Write a config's axis with all its effects, each as the format can say it (`hapticd.export.table`).

    Files that are there are replaced. An earlier module beside an MJCF file that needs none stays where it is.

    Args:
        config: the model.
        to: ``mjcf`` (MuJoCo, with a Python module beside it where that is needed), ``urdf``, ``fmu`` (FMI 2.0
            co-simulation) or ``python`` (a module of the standard library alone).
        target: the file.

    Returns:
        The files written.

    Raises:
        ExportError: the library that the format needs is not installed, or fails.
        OSError: the folder is not there or not writable.
    """
    said = remarks(config, to)
    texts: dict[Path, str] = {}
    if to == "fmu":
        with naming(target), atomic_write(target) as part:
            write_fmu(config, said, part)
        return [target]
    if to == "mjcf":
        module = module_beside(target)
        model = mjcf(config, said, module.stem)
        texts = {target: model.xml} | ({module: model.module} if model.module else {})
    elif to == "urdf":
        from hapticd.export.loss import loss_of_urdf

        texts = {target: urdf(config, [*said, f"All in all: {loss_of_urdf(config).text}."])}
    else:
        texts = {target: module_text(config, "\n".join(["An axis with all that its model says.", "", *said]))}
    for path, text in texts.items():
        with naming(path):
            write_text(path, text)
    return list(texts)
